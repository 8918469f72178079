"""Orchard: walk under falling apples with a basket, and close its lid when a wasp attacks.

Discrete actions only: one branch walks and another closes the lid, both in the same decision.
"""

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from joybridge.contract.tensors import Array
from joybridge.simulator import (
    Action,
    Game,
    TimeStep,
    behavior,
    branch,
    button,
    channel,
    image,
    option,
    sensor,
    spec,
    transition,
    truncation,
)
from joybridge.simulator.canvas import Canvas
from joybridge.v1 import bridge_pb2 as pb

COLUMNS = 7
PAUSE = 3  # decisions between two apples, and the most columns between them: every apple can be reached
APPLES = 20  # per episode
WASP_CHANCE = 0.3  # per decision in which no apple lands
WIDTH, HEIGHT = 320, 240
BACKGROUND = np.full((36, 48, 3), (186, 224, 234), np.uint8)  # of the image that a picker sees: the sky,
BACKGROUND[8:30, 22:26] = 128, 94, 66  # the tree,
BACKGROUND[:8] = 70, 138, 70
BACKGROUND[30:] = 110, 160, 80  # and grass
SENSORS = {
    "state": [
        sensor(
            "apples",
            [2],
            -1,
            1,
            "columns from the basket to the lower and the higher one, as a fraction of the width",
        ),
        sensor("fallen", [1], 0, 1, "fraction of its fall that the lower one has completed"),
        sensor("wasp", [1], 0, 1, "1 if a wasp attacks in the next decision"),
    ],
    "screen": [image("screen", *BACKGROUND.shape[:2], "the whole orchard", channels=3)],
}


class Orchard(Game):
    """One tree with one basket under it."""

    name = "orchard"
    description = "Catch the apples and close the lid when a wasp comes: two branches at once."
    version = "2"
    in_event_loop = True
    options = (option("observation", list(SENSORS), description="what the picker observes: numbers, or an image"),)

    @classmethod
    def describe(cls, options: Mapping[str, str]) -> pb.GameSpec:
        """Return the spec: a branch for walking and a button for the lid."""
        picker = behavior(
            "picker",
            sensors=SENSORS[options["observation"]],
            branches=[branch("walk", ["left", "stay", "right"]), button("lid", "closed while pressed")],
            channels=[
                channel("apple", 1.0, "an apple that falls into the open basket"),
                channel("sting", -1.0, "a wasp that attacks the open basket"),
                channel("shut", -0.1, "a decision with the lid closed"),
            ],
            metrics=["caught", "stings"],
        )
        return spec(cls, [picker], max_episode_decisions=APPLES * PAUSE, tick_seconds=0.2, picture=(WIDTH, HEIGHT))

    def reset(self) -> TimeStep:
        """Begin an episode with the basket in the middle and two apples in the air."""
        self.decisions, self.caught, self.stings = 0, 0, 0
        self.place, self.shut, self.wasp = COLUMNS // 2, False, False
        lower = self._drop(self.place)
        self.apples = [lower, self._drop(lower)]  # their columns
        return transition(self._observe())

    def step(self, action: Action) -> TimeStep:
        """Move the basket and the lid, then the apples and the wasp."""
        self.place = min(COLUMNS - 1, max(0, self.place + int(action["walk"]) - 1))
        self.shut = action["lid"] == 1
        self.decisions += 1
        landed = self.decisions % PAUSE == 0
        caught = landed and self.apples[0] == self.place and not self.shut
        stung = self.wasp and not self.shut
        self.caught, self.stings = self.caught + caught, self.stings + stung
        if landed:
            self.apples = [self.apples[1], self._drop(self.apples[1])]
        self.wasp = (self.decisions + 1) % PAUSE != 0 and bool(self.rng.random() < WASP_CHANCE)
        rewards = {"apple": float(caught), "sting": float(stung), "shut": float(self.shut)}
        if self.decisions < APPLES * PAUSE:
            return transition(self._observe(), rewards)
        return truncation(self._observe(), rewards, {"caught": self.caught / APPLES, "stings": self.stings})

    def _drop(self, near: int) -> int:
        return int(self.rng.integers(max(0, near - PAUSE), min(COLUMNS, near + PAUSE + 1)))

    def _observe(self) -> Mapping[str, npt.ArrayLike]:
        if self.option["observation"] == "screen":
            return {"screen": self._paint()}
        apples = [(apple - self.place) / (COLUMNS - 1) for apple in self.apples]
        return {"apples": apples, "fallen": [self.decisions % PAUSE / (PAUSE - 1)], "wasp": [float(self.wasp)]}

    def _paint(self) -> Array:
        """Return what the picker sees: two falling apples, the basket with its lid, and a wasp above it."""
        canvas = Canvas(BACKGROUND, left=-24, top=40, unit=1)
        x = 6 * (self.place - COLUMNS // 2)
        for number, column in enumerate(self.apples, start=1):
            left = number * PAUSE - self.decisions % PAUSE
            canvas.disc((6 * (column - COLUMNS // 2), 10 + 4 * left), 1.4, (214, 52, 48))
        canvas.box(x - 3, 6, x + 3, 10, (150, 100, 50))
        lid = ((x - 3, 10), (x + 3, 10)) if self.shut else ((x - 3, 10), (x - 5, 15))
        canvas.line(*lid, 1.2, (96, 56, 24))
        if self.wasp:
            canvas.disc((x, 15), 1.8, (250, 204, 56))
        return canvas.pixels

    def draw(self) -> Array:
        """Return a picture: the tree, two falling apples, the basket with its lid, and a wasp above it."""
        import pygame  # imported here because only pictures need it

        from joybridge.simulator.render import FINE, disc, fade, picture, write

        canvas = pygame.Surface((WIDTH * FINE, HEIGHT * FINE))
        width, height = canvas.get_size()
        fade(canvas, canvas.get_rect(), (134, 200, 232), (236, 247, 236))
        pygame.draw.ellipse(canvas, (164, 202, 128), (-80, 340, 520, 200))
        fade(canvas, pygame.Rect(0, 392, width, 88), (128, 178, 92), (92, 146, 70))
        pygame.draw.polygon(canvas, (128, 94, 66), [(296, 0), (344, 0), (350, 380), (376, 404), (264, 404), (290, 380)])
        pygame.draw.polygon(canvas, (110, 78, 54), [(328, 0), (344, 0), (350, 380), (376, 404), (336, 404)])
        for depth, green in enumerate(((50, 110, 60), (70, 138, 70), (98, 168, 84))):
            for leaf in range(-1, 11):
                disc(canvas, np.array([leaf * 68 + 30 * depth, 66 - 34 * depth + 9 * (leaf % 3)]), 48, green)

        def apple(x: float, y: float) -> None:
            disc(canvas, np.array([x, y]), 17, (214, 52, 48))
            disc(canvas, np.array([x - 6, y - 6]), 5, (250, 160, 140))
            pygame.draw.line(canvas, (92, 66, 44), (x, y - 14), (x + 4, y - 25), 4)

        def at(column: int) -> float:
            return width / 2 + (column - COLUMNS // 2) * 78

        x, y = at(self.place), 400
        for number, column in enumerate(self.apples, start=1):
            apple(at(column), y - 52 * (number * PAUSE - self.decisions % PAUSE))
        for side in (-15, 15)[: self.caught]:
            apple(x + side, y + 2)
        pygame.draw.polygon(canvas, (190, 138, 78), [(x - 42, y), (x + 42, y), (x + 30, y + 48), (x - 30, y + 48)])
        for band in (14, 31):
            pygame.draw.line(canvas, (152, 104, 56), (x - 42 + band / 4, y + band), (x + 42 - band / 4, y + band), 5)
        lid = ((x - 46, y), (x + 46, y)) if self.shut else ((x - 44, y), (x - 66, y - 66))
        pygame.draw.line(canvas, (126, 82, 44), *lid, 14)
        if self.wasp:
            for side in (-14, 10):
                pygame.draw.ellipse(canvas, (246, 250, 255), (x + side - 8, y - 106, 20, 32))
            pygame.draw.ellipse(canvas, (250, 204, 56), (x - 28, y - 84, 56, 28))
            for stripe in (-12, 2, 16):
                pygame.draw.line(canvas, (46, 38, 34), (x + stripe, y - 81), (x + stripe, y - 59), 7)
        write(canvas, f"{self.caught} apples, {self.stings} stings", 34, (252, 252, 240), 14, height - 18)
        return picture(canvas)
