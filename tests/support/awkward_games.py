"""Games as strangers write them, with which training must cope."""

import numpy as np

from joybridge.simulator import Game, behavior, button, channel, sensor, spec, transition, truncation

LENGTH = 5
PICTURE = (101, 75)  # width, height

print("a game may print before its simulator listens")


class Talkative(Game):
    """Prints a lot, has no snapshots, an odd picture, and names that look like paths, columns and markup."""

    name = "talkative"
    description = "Press the button as it is lit."

    @classmethod
    def describe(cls, options):
        player = behavior(
            "../red/left", sensors=[sensor("lamp", [1])], branches=[button("press")], metrics=["length", "speed [/]"]
        )
        return spec(cls, [player], max_episode_decisions=LENGTH, picture=PICTURE)

    def reset(self):
        self.steps = 0
        return transition(self.show())

    def show(self):
        self.lamp = int(self.rng.integers(2))
        return {"lamp": [self.lamp + self.rng.random() / 2]}

    def step(self, action):
        print("x" * 2000)
        self.steps += 1
        rewards = {"reward": float(action["press"] == self.lamp)}
        if self.steps < LENGTH:
            return transition(self.show(), rewards)
        return truncation(self.show(), rewards, {"length": self.steps, "speed [/]": 1.0})

    def draw(self):
        width, height = PICTURE
        return np.full((height, width, 3), 90 * self.steps % 256, np.uint8)


class Generous(Game):
    """Pays more than 32 bits hold, though no single reward does."""

    name = "generous"
    description = "Be rich."

    @classmethod
    def describe(cls, options):
        channels = [channel("gold"), channel("silver")]
        player = behavior("player", sensors=[sensor("sight", [1])], branches=[button("press")], channels=channels)
        return spec(cls, [player])

    def reset(self):
        self.steps = 0
        return transition({"sight": [0.0]})

    def step(self, action):
        self.steps += 1
        reward = 2e38 if self.steps == 60 else float(action["press"])
        return transition({"sight": [1.0]}, {"gold": reward, "silver": reward})


class Thrifty(Game):
    """Keeps its numbers in arrays that it writes anew in each episode."""

    name = "thrifty"
    description = "Count to three."

    @classmethod
    def describe(cls, options):
        player = behavior("player", sensors=[sensor("board", [2])], branches=[button("press")], metrics=["count"])
        return spec(cls, [player])

    def __init__(self):
        self.board, self.counts = np.zeros(2, np.float32), {"count": 0.0}

    def reset(self):
        self.board[:], self.counts["count"] = 0.0, 0.0
        return transition({"board": self.board})

    def step(self, action):
        self.board += 1.0
        self.counts["count"] += 1.0
        if self.board[0] < 3.0:
            return transition({"board": self.board})
        return truncation({"board": self.board}, {}, self.counts)
