"""Tiny games: what the tests let the real server run besides its own.

A server gets them with `--game tests.support.games:CLASS`; PLACES lists all of them.
"""

from dataclasses import replace

import numpy as np

from joybridge.simulator import (
    BatchedGame,
    Game,
    axis,
    behavior,
    branch,
    button,
    channel,
    image,
    option,
    parameter,
    quiet_step,
    sensor,
    spec,
    termination,
    transition,
    truncation,
    waiting,
)
from tests.support.faulty_game import PICTURE, Faulty


class Hybrid(Game):
    """Well-behaved: every dtype, two axes, two branches, one of them masked, a picture, ends of both kinds."""

    name = "hybrid"
    description = "Move a point with two axes, pick a gear that the last one allows, and press the button."
    options = (
        option("size", ["small", "large"]),
        option("masks", ["on", "off"]),
    )

    @classmethod
    def describe(cls, options):
        cells = 2 if options["size"] == "small" else 5
        player = behavior(
            "player",
            sensors=[
                sensor("place", [2], -9.0, 9.0),
                sensor("count", [1], dtype=np.int32),
                sensor("image", [2, cells], dtype=np.uint8),
                sensor("lamps", [3], dtype=bool),
            ],
            axes=[axis("x"), axis("force", 0.5, 2.0)],
            branches=[branch("gear", ["low", "middle", "high"]), button("press")],
            channels=[channel("gain"), channel("cost", 0.5)],
            metrics=["length", "presses"],
        )
        drift = parameter("drift", 0.0, 2.0, default=1.0)
        return spec(cls, [player], parameters=[drift], max_episode_decisions=9, tick_seconds=0.1, picture=PICTURE)

    def reset(self):
        self.place = self.rng.uniform(-1.0, 1.0, 2)
        self.length = self.presses = self.gear = 0
        return self.timestep()

    def step(self, action):
        self.length += 1
        self.presses += action["press"]
        self.gear = action["gear"]
        self.place = np.clip(
            self.place + action["x"] * action["force"] + self.rng.normal(0.0, self.parameter["drift"], 2), -9.0, 9.0
        )
        rewards = {"gain": float(self.place[0]), "cost": -0.25 * action["press"]}
        metrics = {"length": self.length, "presses": self.presses}
        if np.abs(self.place).max() > 3.0:
            return replace(self.timestep(), rewards=rewards, metrics=metrics, terminated=True)
        if self.length == 9:
            return replace(self.timestep(), rewards=rewards, metrics=metrics, truncated=True)
        return replace(self.timestep(), rewards=rewards)

    def timestep(self):
        cells = 2 if self.option["size"] == "small" else 5
        observation = {
            "place": self.place,
            "count": [self.length],
            "image": np.full((2, cells), self.gear),
            "lamps": [bit == self.gear for bit in range(3)],
        }
        gears = [abs(gear - self.gear) <= 1 for gear in range(3)]  # one gear at a time
        return transition(observation, masks={"gear": gears} if self.option["masks"] == "on" else None)

    def draw(self):
        width, height = PICTURE
        return np.full((height, width, 3), [self.length, self.presses, self.gear], np.uint8)


class Duel(Game):
    """Two behaviors that take turns: one of two runners decides, or the judge does, and the others wait."""

    name = "duel"
    description = "Two runners and a judge act one after the other."

    @classmethod
    def describe(cls, options):
        runner = behavior("runner", sensors=[sensor("track", [2])], axes=[axis("pace")], agents=2, metrics=["distance"])
        judge = behavior(
            "judge", sensors=[sensor("lead", [1])], branches=[branch("verdict", ["none", "left", "right"])]
        )
        return spec(cls, [runner, judge])

    def reset(self):
        self.distance = [float(self.rng.random()) for _ in range(2)]
        self.clock = 0
        return self.timesteps([0.0, 0.0, 0.0])

    def step(self, actions):
        rewards = [0.0, 0.0, 0.0]
        mover = self.clock % 3
        if mover == 2:
            lead = int(self.distance[1] > self.distance[0])
            rewards[2] = float(actions[2]["verdict"] == lead + 1)
        else:
            self.distance[mover] += actions[mover]["pace"]
            rewards = [-0.5, -0.5, -0.5]
            rewards[mover] = actions[mover]["pace"]
        self.clock += 1
        return self.timesteps(rewards)

    def timesteps(self, rewards):
        observations = [{"track": [own, self.clock]} for own in self.distance]
        observations.append({"lead": [self.distance[1] - self.distance[0]]})
        paid = [{"reward": reward} for reward in rewards]
        if self.clock == 10:
            metrics = [{"distance": self.distance[0]}, {"distance": self.distance[1]}, {}]
            return [truncation(*parts) for parts in zip(observations, paid, metrics, strict=True)]
        return [
            (transition if agent == self.clock % 3 else waiting)(observations[agent], paid[agent]) for agent in range(3)
        ]


class Ends(Game):
    """Episodes of two decisions that end by turns terminated and truncated."""

    name = "ends"
    description = "Wait for the end, whichever it is."
    episode = 0

    @classmethod
    def describe(cls, options):
        return spec(cls, [behavior("player", sensors=[sensor("clock", [2])], branches=[button("press")])])

    def reset(self):
        self.clock = 0
        self.episode += 1
        return transition({"clock": [self.episode, 0.0]})

    def step(self, action):
        self.clock += 1
        observation, rewards = {"clock": [self.episode, self.clock]}, {"reward": 1.0}
        if self.clock < 2:
            return transition(observation, rewards)
        return (termination if self.episode % 2 else truncation)(observation, rewards)


class Kick(Game):
    """An image, and an axis that counts only with one choice."""

    name = "kick"
    description = "Kick a ball along a line; the force counts only in a kick."
    version = "1"

    @classmethod
    def describe(cls, options):
        kicker = behavior(
            "kicker",
            sensors=[image("line", 1, 8)],
            axes=[axis("force", only_with=("foot", "kick"))],
            branches=[branch("foot", ["rest", "kick"])],
        )
        return spec(cls, [kicker], max_episode_decisions=20)

    def reset(self):
        self.ball, self.clock = float(self.rng.uniform(2.0, 6.0)), 0
        return transition(self.observation())

    def step(self, action):
        self.clock += 1
        if action["foot"] == 1:
            self.ball = float(np.clip(self.ball + action["force"], 0.0, 7.0))
        return (transition if self.clock < 20 else truncation)(self.observation(), {"reward": self.ball})

    def observation(self):
        shades = np.clip(255 * (1 - np.abs(np.arange(8) - self.ball)), 0, 255)
        return {"line": shades.astype(np.uint8).reshape(1, 8, 1)}


class Gallery(Game):
    """Two images that nobody can foresee, one of them in color, beside two numbers."""

    name = "gallery"
    description = "Look at pictures, and move while you do."
    options = (option("pixels", ["9", "20", "36"]),)

    @classmethod
    def describe(cls, options):
        size = int(options["pixels"])
        visitor = behavior(
            "visitor",
            sensors=[image("map", size, size + 3), sensor("place", [2]), image("view", size, size, channels=3)],
            axes=[axis("x"), axis("y", 0.0, 2.0)],
            branches=[branch("gear", ["low", "middle", "high"]), button("press")],
        )
        return spec(cls, [visitor], max_episode_decisions=7)

    def reset(self):
        self.clock = 0
        return transition(self.observation(), masks=self.masks())

    def step(self, action):
        self.clock += 1
        pays = {"reward": action["x"]}
        if self.clock == 7:
            return truncation(self.observation(), pays)
        return transition(self.observation(), pays, masks=self.masks())

    def observation(self):
        size = int(self.option["pixels"])
        return {
            "map": self.rng.integers(0, 256, (size, size + 3, 1)),
            "place": self.rng.normal(0.0, 1.0, 2),
            "view": self.rng.integers(0, 256, (size, size, 3)),
        }

    def masks(self):
        return {"gear": [self.clock % 3 != gear for gear in range(3)]}


class Raises(Game):
    """A bug in the third step of every episode."""

    name = "raises"
    description = "Divide by what is left."

    @classmethod
    def describe(cls, options):
        return spec(cls, [behavior("player", sensors=[sensor("left", [1])], branches=[button("press")])])

    def reset(self):
        self.left = 3
        return transition({"left": [self.left]})

    def step(self, action):
        self.left -= 1
        return transition({"left": [1 / self.left]})


class Brittle(Game):
    """Plays for more than a thousand decisions, and then fails in one that its random numbers choose."""

    name = "brittle"
    description = "Go deeper for as long as the roof holds."
    options = (option("roof", ["weak", "strong"]),)

    @classmethod
    def describe(cls, options):
        player = behavior("player", sensors=[sensor("place", [2])], branches=[button("press")], metrics=["depth"])
        return spec(cls, [player])

    def __init__(self):
        self.place, self.lasts = np.zeros(2), 0

    def reset(self):
        self.lasts = self.lasts or self.decisions()
        self.clock = 0
        return transition({"place": self.look()})

    def decisions(self):
        """Return after how many decisions it fails, counted from when it was made."""
        return int(self.rng.integers(1001, 1100))

    def step(self, action):
        self.clock += 1
        self.lasts -= 1
        place = self.look()
        if self.lasts == 0 and self.option["roof"] == "weak":
            place[:] = np.nan  # a game that fails may leave anything behind
            raise RuntimeError("the roof fell in")
        if self.clock == 60:
            return termination({"place": place}, {"reward": 1.0}, {"depth": 60.0})
        return transition({"place": place}, {"reward": 1.0})

    def look(self):
        self.place[:] = self.clock, self.rng.random()
        return self.place


class Farthest(Game):
    """A game whose axis reaches as far as floats do, with a parameter that has one value only."""

    name = "farthest"
    description = "Pull as far as floats reach."
    parameters = (parameter("one", 1.0, 1.0, 1.0),)

    @classmethod
    def describe(cls, options):
        far = float(np.finfo(np.float32).max)
        return spec(cls, [behavior("player", sensors=[sensor("light", [1])], axes=[axis("pull", -far, far)])])

    def reset(self):
        return transition({"light": [self.rng.random()]})

    def step(self, action):
        return transition({"light": [self.rng.random()]})


class Batch(BatchedGame):
    """A game over all arenas at once, which may break what a service expects of it."""

    name = "batch"
    description = "Wait; and sometimes fail."

    options = (option("fault", ["none", "exit", "doubles"]),)

    @classmethod
    def describe(cls, options):
        player = behavior("player", sensors=[sensor("sight", [2])], branches=[button("press")])
        return spec(cls, [player], max_arenas=8)

    def __init__(self, options, parameters, arenas, first_arena, seed):
        self.fault, self.arenas = options["fault"], arenas

    def reset(self, seed, parameters):
        pass

    def observe(self):
        return [quiet_step([np.zeros((self.arenas, 2), np.float32)], 1)]

    def step(self, acts):
        if self.fault == "exit":
            raise SystemExit(5)
        return [quiet_step([np.zeros((self.arenas, 2), float if self.fault == "doubles" else np.float32)], 1)]


# ------------------------------------------------------------------------ games that no server can begin to serve


class Unnamed(Game):
    """A game that somebody forgot to name."""

    description = "nothing"

    @classmethod
    def describe(cls, options):
        return spec(cls, [behavior("player", sensors=[sensor("sight", [1])], branches=[button("press")])])

    def reset(self):
        raise NotImplementedError

    def step(self, action):
        raise NotImplementedError


class Namesake(Unnamed):
    """A game with another one's name."""

    name = "hybrid"


class BrokenChoice(Unnamed):
    """A game whose spec breaks the contract under one choice of an option."""

    name = "broken_choice"
    options = (option("agents", ["one", "none"]),)

    @classmethod
    def describe(cls, options):
        agents = int(options["agents"] == "one")
        player = behavior("player", sensors=[sensor("sight", [1])], branches=[button("press")], agents=agents)
        return spec(cls, [player])


PLACES = [
    f"{game.__module__}:{game.__name__}" for game in (Hybrid, Duel, Ends, Kick, Gallery, Raises, Brittle, Faulty, Batch)
]
