"""A game that makes the mistake that one asks for, and what the error about it must say."""

import numpy as np

from joybridge.simulator import Game, TimeStep, behavior, button, option, sensor, spec, termination, transition

PICTURE = (8, 6)  # width, height


# What a faulty game can do wrong in its first step, and a word that the error must hold.
FAULTS = {
    "NaN observation": "sight",
    "infinite observation": "sight",
    "NaN reward": "reward",
    "NaN metric": "score",
    "observation that no float can hold": "sight",
    "reward that no float can hold": "OverflowError",
    "metric that no float can hold": "OverflowError",
    "mask that is a number": "TypeError",
    "unknown channel": "bonus",
    "unknown metric": "style",
    "missing sensor": "sight",
    "observation of another shape": "sight",
    "no choice allowed": "press",
    "mask of another length": "press",
    "mask of an unknown branch": "jump",
    "nothing returned": "None",
    "two timesteps for one agent": "2 timesteps",
    "exit": "SystemExit",
    "words that no wire carries": "ValueError",
    "picture of another size": "draw",
    "picture of floats": "draw",
    "exit while drawing": "SystemExit: 4",
    "end at reset": "reset",
    "start fails": "ZeroDivisionError",
    "spec without sensors": "no sensors",
    "describe fails": "ZeroDivisionError",
}


class Faulty(Game):
    """Every mistake that an author can make, by option."""

    name = "faulty"
    description = "Make a mistake."
    options = (
        option("fault", ["none", *FAULTS]),
        option("armed", ["no", "yes"]),  # "no": the fault is not in the spec, which is checked when the game is loaded
    )

    @classmethod
    def describe(cls, options):
        fault = options["fault"] if options["armed"] == "yes" else "none"
        if fault == "describe fails":
            raise ZeroDivisionError
        sensors = [] if fault == "spec without sensors" else [sensor("sight", [2])]
        player = behavior("player", sensors=sensors, branches=[button("press")], metrics=["score"])
        return spec(cls, [player], picture=PICTURE)

    def reset(self):
        if self.option["fault"] == "start fails":
            raise ZeroDivisionError
        first = {"sight": [0.0, 0.0]}
        return termination(first) if self.option["fault"] == "end at reset" else transition(first)

    def step(self, action):
        observation = {"sight": [0.0, 0.0]}
        of_a_wrong_kind = {
            "observation that no float can hold": TimeStep({"sight": [0.0, 10**400]}),
            "reward that no float can hold": TimeStep(observation, rewards={"reward": 10**400}),
            "metric that no float can hold": TimeStep(observation, metrics={"score": 10**400}, terminated=True),
            "nothing returned": None,
            "mask that is a number": TimeStep(observation, masks={"press": 1}),  # type: ignore[dict-item]
        }
        if self.option["fault"] in of_a_wrong_kind:
            return of_a_wrong_kind[self.option["fault"]]
        match self.option["fault"]:
            case "NaN observation":
                return transition({"sight": [0.0, np.nan]})
            case "infinite observation":
                return transition({"sight": [0.0, 1e39]})  # finite until it is a float32
            case "NaN reward":
                return transition(observation, {"reward": np.nan})
            case "NaN metric":
                return termination(observation, metrics={"score": np.nan})
            case "unknown channel":
                return transition(observation, {"bonus": 1.0})
            case "unknown metric":
                return termination(observation, metrics={"style": 1.0})
            case "missing sensor":
                return transition({})
            case "observation of another shape":
                return transition({"sight": [1.0, 2.0, 3.0]})
            case "no choice allowed":
                return transition(observation, masks={"press": [False, False]})
            case "mask of another length":
                return transition(observation, masks={"press": [True, True, True]})
            case "mask of an unknown branch":
                return transition(observation, masks={"jump": [True, True]})
            case "two timesteps for one agent":
                return [transition(observation)] * 2
            case "exit":
                raise SystemExit(3)
            case "words that no wire carries":
                raise ValueError("\udcff" + "ü" * 100_000)
        return transition(observation)

    def draw(self):
        width, height = PICTURE
        match self.option["fault"]:
            case "picture of another size":
                return np.zeros((width, height, 3), np.uint8)
            case "exit while drawing":
                raise SystemExit(4)
            case "picture of floats":
                return np.zeros((height, width, 3))
        return np.zeros((height, width, 3), np.uint8)
