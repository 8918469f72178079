"""Games with known answers: what was shown is what pays."""

import numpy as np

from joybridge.simulator import (
    Game,
    TimeStep,
    axis,
    behavior,
    branch,
    button,
    image,
    sensor,
    spec,
    transition,
    truncation,
)

LENGTH = 8


class Identity(Game):
    """Every step shows a target; the nearer the action, the more it pays, 1 at most."""

    description = "Do what you see."
    axes: tuple[str, ...] = ()
    buttons: tuple[str, ...] = ()
    choices = 0

    @classmethod
    def describe(cls, options):
        player = behavior(
            "player",
            sensors=[sensor("target", [cls.size()], -1, 1)],
            axes=[axis(name) for name in cls.axes],
            branches=[button(name) for name in cls.buttons]
            + ([branch("choice", [f"c{i}" for i in range(cls.choices)])] if cls.choices else []),
            metrics=["length"],
        )
        return spec(cls, [player], max_episode_decisions=LENGTH)

    @classmethod
    def size(cls) -> int:
        """Return the numbers in a target: one per axis and button, and one per choice."""
        return len(cls.axes) + len(cls.buttons) + cls.choices

    def reset(self) -> TimeStep:
        self.steps = 0
        return transition(self.show())

    def show(self):
        self.aims = self.rng.uniform(-0.8, 0.8, len(self.axes))
        self.presses = self.rng.integers(0, 2, len(self.buttons))
        self.choice = self.rng.integers(self.choices) if self.choices else 0
        lamps = [1.0 if self.choice == i else 0.0 for i in range(self.choices)]
        return {"target": [*self.aims, *self.presses, *lamps]}

    def step(self, action) -> TimeStep:
        score = [1 - min(1.0, abs(action[name] - aim)) for name, aim in zip(self.axes, self.aims, strict=True)]
        score += [float(action[n] == press) for n, press in zip(self.buttons, self.presses, strict=True)]
        if self.choices:
            score.append(float(action["choice"] == self.choice))
        self.steps += 1
        rewards = {"reward": sum(score) / len(score)}
        if self.steps < LENGTH:
            return transition(self.show(), rewards)
        return truncation(self.show(), rewards, {"length": self.steps})


class Discrete(Identity):
    """Branches only."""

    name = "identity_discrete"
    buttons = ("a", "b")
    choices = 4


class Continuous(Identity):
    """Axes only."""

    name = "identity_continuous"
    axes = ("x", "y")


class Hybrid(Identity):
    """Both at once."""

    name = "identity_hybrid"
    axes = ("x",)
    buttons = ("a",)
    choices = 3


class Far(Hybrid):
    """As Hybrid, but targets are shown in huge units, far from 0."""

    name = "identity_far"

    @classmethod
    def describe(cls, options):
        made = super().describe(options)
        made.behaviors[0].sensors[0].low[:], made.behaviors[0].sensors[0].high[:] = [20_000.0], [40_000.0]
        return made

    def show(self):
        return {"target": [30_000.0 + 10_000.0 * number for number in super().show()["target"]]}


class Shown(Identity):
    """A bright square in one quarter of a picture, beside a number that tells whether to press the button."""

    name = "identity_shown"
    buttons = ("a",)
    choices = 4

    @classmethod
    def describe(cls, options):
        made = super().describe(options)
        made.behaviors[0].sensors[0].shape[:] = [1]
        made.behaviors[0].sensors.append(sensor("picture", [8, 8, 3], dtype=np.uint8))
        return made

    def show(self):
        pressed, *_ = super().show()["target"]
        picture = np.zeros((8, 8, 3), np.uint8)
        row, column = self.rng.integers(0, 2, 2) + 4 * np.array([self.choice // 2, self.choice % 2])
        picture[row : row + 3, column : column + 3] = 255
        return {"target": [pressed], "picture": picture}


class Moles(Game):
    """A mole appears in a picture, and a click on it pays. Half of the time, one that sleeps is beside it."""

    name = "moles"
    description = "Click the bright moles."
    size = (24, 32)  # height, width

    @classmethod
    def describe(cls, options):
        player = behavior(
            "player",
            sensors=[image("field", *cls.size)],
            axes=[axis("x", description="-1 is the left edge"), axis("y", description="-1 is the bottom edge")],
            branches=[button("click")],
            metrics=["length"],
        )
        return spec(cls, [player], max_episode_decisions=LENGTH)

    def reset(self) -> TimeStep:
        self.steps = 0
        return transition(self.show())

    def show(self):
        rows, columns = np.indices(self.size)
        picture = np.zeros((*self.size, 1), np.uint8)
        for gray in [90, 255][self.rng.integers(2) :]:
            self.place = self.rng.integers(3, np.array(self.size) - 3)
            picture[(rows - self.place[0]) ** 2 + (columns - self.place[1]) ** 2 <= 8] = gray
        return {"field": picture}

    def step(self, action) -> TimeStep:
        height, width = self.size
        down, right = (1 - action["y"]) / 2 * height - 0.5, (1 + action["x"]) / 2 * width - 0.5
        near = np.hypot(down - self.place[0], right - self.place[1]) <= 3
        self.steps += 1
        rewards = {"reward": float(near and action["click"])}
        if self.steps < LENGTH:
            return transition(self.show(), rewards)
        return truncation(self.show(), rewards, {"length": self.steps})
