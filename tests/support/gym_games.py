"""Tiny games whose numbers a test can predict."""

import numpy as np

from joybridge.simulator import (
    Game,
    axis,
    behavior,
    branch,
    button,
    channel,
    parameter,
    sensor,
    spec,
    termination,
    transition,
    truncation,
    waiting,
)


class Brief(Game):
    """Episodes of one to four decisions; odd lengths terminate, even ones are truncated."""

    name = "brief"
    description = "Short episodes."

    @classmethod
    def describe(cls, options):
        player = behavior(
            "player",
            sensors=[sensor("clock", [1], 10.0, 20.0), sensor("noise", [2, 1], -1.0)],
            axes=[axis("lever", -2.0, 4.0)],
            branches=[button("press"), branch("gear", ["low", "middle", "high"])],
            channels=[channel("lever"), channel("press", 0.5), channel("gear", 0.0)],
            metrics=["length", "presses"],
        )
        shift = parameter("shift", 0.0, 5.0, default=0.0, description="added to the clock")
        return spec(cls, [player], parameters=[shift], tick_seconds=0.1, picture=(6, 4))

    def reset(self):
        self.length, self.clock, self.presses = int(self.rng.integers(1, 5)), 0, 0
        return transition(self.observation())

    def step(self, action):
        self.clock += 1
        self.presses += action["press"]
        rewards = {name: action[name] for name in ("lever", "press", "gear")}
        if self.clock < self.length:
            return transition(self.observation(), rewards)
        end = termination if self.length % 2 else truncation
        return end(self.observation(), rewards, {"length": self.length, "presses": self.presses})

    def observation(self):
        return {"clock": [10 + self.clock + self.parameter["shift"]], "noise": self.rng.random((2, 1))}

    def draw(self):
        return np.full((4, 6, 3), 10 + self.clock, np.uint8)


class Turns(Game):
    """Two agents of one behavior take turns; who is next may not repeat the other's last choice."""

    name = "turns"
    description = "Two agents take turns."

    @classmethod
    def describe(cls, options):
        player = behavior(
            "player",
            sensors=[sensor("count", [1], 0.0, 9.0)],
            branches=[branch("card", ["ace", "king", "queen"])],
            agents=2,
        )
        return spec(cls, [player])

    def reset(self):
        self.count, self.last = 0, 0
        return self.turns({})

    def step(self, actions):
        self.last = actions[self.count % 2]["card"]
        self.count += 1
        if self.count < 9:
            return self.turns({"reward": 1.0 + self.last})
        return [termination({"count": [self.count]}, {"reward": 1.0 + self.last})] * 2

    def turns(self, rewards):
        next_ = self.count % 2
        observation = {"count": [self.count]}
        turns = [waiting(observation, rewards), waiting(observation, rewards)]
        turns[next_] = transition(observation, rewards, {"card": [choice != self.last for choice in range(3)]})
        return turns


class Chase(Game):
    """A hunter and two runners."""

    name = "chase"
    description = "A hunter follows two runners."

    @classmethod
    def describe(cls, options):
        hunter = behavior("hunter", sensors=[sensor("gap", [2], -100.0, 100.0)], axes=[axis("speed")])
        runner = behavior(
            "runner",
            sensors=[sensor("place", [1], -100.0, 100.0)],
            branches=[branch("way", ["back", "stay", "on"]), button("jump")],
            channels=[channel("fled"), channel("jumped", -1.0)],
            metrics=["place"],
            agents=2,
        )
        return spec(cls, [hunter, runner], picture=(3, 2))

    def reset(self):
        self.hunter, self.runners, self.count = -5.0, self.rng.uniform(-1.0, 1.0, 2), 0
        return [transition(observation) for observation in self.observations()]

    def step(self, actions):
        self.count += 1
        self.hunter += actions[0]["speed"]
        steps = np.array([action["way"] - 1 for action in actions[1:]])
        self.runners = self.runners + steps
        rewards = [{"reward": self.hunter}]
        rewards += [{"fled": float(s), "jumped": a["jump"]} for s, a in zip(steps, actions[1:], strict=True)]
        pairs = zip(self.observations(), rewards, strict=True)
        if self.count < 20:
            return [transition(observation, reward) for observation, reward in pairs]
        return [termination(o, r, {"place": o["place"][0]} if "place" in o else None) for o, r in pairs]

    def observations(self):
        return [{"gap": self.runners - self.hunter}] + [{"place": [place]} for place in self.runners]

    def draw(self):
        return np.full((2, 3, 3), self.count, np.uint8)


class Gallery(Game):
    """A sensor of each dtype."""

    name = "gallery"
    description = "Every kind of sensor."

    @classmethod
    def describe(cls, options):
        player = behavior(
            "player",
            sensors=[
                sensor("image", [36, 40, 1], dtype="uint8"),
                sensor("count", [1], low=-7, dtype="int32"),
                sensor("lamp", [2], dtype="bool"),
            ],
            branches=[button("press")],
        )
        return spec(cls, [player])

    def reset(self):
        self.count = 2**24
        return transition(self.observe())

    def step(self, action):
        end = self.count > 2**24 + 5
        return termination(self.observe()) if end else transition(self.observe())

    def observe(self):
        self.count += 1
        image = self.rng.integers(0, 255, (36, 40, 1))
        image[0, 0, 0] = 255
        return {"image": image, "count": [self.count], "lamp": [True, False]}
