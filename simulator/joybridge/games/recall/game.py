"""Recall: a light shows a color, and the color is asked for later. Nothing else tells which it was.

With the option task=cue, the light shines at the first decision only, and the answer counts `delay` decisions later,
when `asked` is 1. With task=echo, it shows a color at every decision, and each answer is to name the color of eight
decisions before. Who guesses is right in a quarter of the cases.
"""

from collections.abc import Mapping

import numpy as np

from joybridge.contract.tensors import Array
from joybridge.simulator import (
    Action,
    Game,
    TimeStep,
    behavior,
    branch,
    option,
    parameter,
    sensor,
    spec,
    termination,
    transition,
)
from joybridge.v1 import bridge_pb2 as pb

COLORS = ("red", "green", "blue", "yellow")
PAINTS = ((214, 68, 60), (64, 160, 92), (47, 111, 180), (232, 190, 60))
BACK, ANSWERS = 8, 24  # of task=echo: decisions between color and answer, and answers in an episode
WIDTH, HEIGHT = 320, 200


class Recall(Game):
    """One light and four buttons."""

    name = "recall"
    description = "A light shows a color that is asked for later: impossible without memory."
    version = "1"
    options = (option("task", ["cue", "echo"], description="cue: one color, asked for once; echo: one per decision"),)
    in_event_loop = True

    @classmethod
    def describe(cls, options: Mapping[str, str]) -> pb.GameSpec:
        """Return the spec: what shines, whether an answer counts, and one button of four."""
        player = behavior(
            "player",
            description="reward: 1 shared among the answers that count, for those that are right",
            sensors=[
                sensor("shown", [len(COLORS)], 0, 1, "1 for the color that shines now; all 0: none"),
                sensor("asked", [1], 0, 1, "1 if the answer to this counts"),
            ],
            branches=[branch("answer", list(COLORS))],
            metrics=["right"],
        )
        return spec(
            cls,
            [player],
            parameters=[parameter("delay", 1, 1000, 30, "decisions between color and answer; of task=cue only")],
            picture=(WIDTH, HEIGHT),
        )

    def reset(self) -> TimeStep:
        """Begin an episode; its colors are random."""
        self.echo = self.option["task"] == "echo"
        self.back = BACK if self.echo else round(self.parameter["delay"])
        self.answers = ANSWERS if self.echo else 1
        self.colors = self.rng.integers(len(COLORS), size=self.answers)
        self.time, self.right = 0, 0
        return transition(self._observe())

    def step(self, action: Action) -> TimeStep:
        """Take an answer, which counts if a color was shown `back` decisions before."""
        reward = 0.0
        if self.time >= self.back:
            right = int(action["answer"]) == self.colors[self.time - self.back]
            self.right += right
            reward = float(right) / self.answers
        self.time += 1
        if self.time == self.back + self.answers:
            return termination(self._observe(), {"reward": reward}, {"right": self.right / self.answers})
        return transition(self._observe(), {"reward": reward})

    def _observe(self) -> dict[str, list[float]]:
        shown = [0.0] * len(COLORS)
        if self.time < self.answers:
            shown[self.colors[self.time]] = 1.0
        return {"shown": shown, "asked": [float(self.back <= self.time < self.back + self.answers)]}

    def draw(self) -> Array:
        """Return a picture of the light above the four buttons."""
        import pygame  # imported here because only pictures need it

        from joybridge.simulator.render import FINE, disc, picture

        canvas = pygame.Surface((WIDTH * FINE, HEIGHT * FINE))
        canvas.fill((40, 44, 52))
        light = PAINTS[self.colors[self.time]] if self.time < self.answers else (72, 78, 88)
        disc(canvas, np.array([WIDTH / 2, 66]) * FINE, 44 * FINE, light)
        edge = (250, 250, 250) if self.time >= self.back else (72, 78, 88)  # the buttons wait for an answer
        for number, paint in enumerate(PAINTS):
            place = np.array([WIDTH / 2 + (number - 1.5) * 64, 158]) * FINE
            disc(canvas, place, 24 * FINE, edge)
            disc(canvas, place, 20 * FINE, paint)
        return picture(canvas)
