"""Marble: tilt a board in two directions to roll a marble into a ring without losing it over the edge.

Continuous actions only: two axes at once, and a marble with inertia.
"""

from collections.abc import Mapping

import numpy as np

from joybridge.contract.tensors import Array
from joybridge.simulator import (
    Action,
    Game,
    TimeStep,
    axis,
    behavior,
    image,
    option,
    sensor,
    spec,
    termination,
    transition,
    truncation,
)
from joybridge.simulator.canvas import Canvas
from joybridge.v1 import bridge_pb2 as pb

DECISIONS = 120  # per episode
RING_DECISIONS = 30  # until the ring moves to another place
RING, MARBLE = 0.22, 0.08  # radii; the board reaches from -1 to 1
PULL = 0.02  # speed that full tilt adds per decision
ROLLS = 0.95  # fraction of its speed that the marble keeps per decision
FASTEST = PULL / (1 - ROLLS)  # the speed at constant full tilt
SIZE, VIEW = 280, 1.25  # of the picture: pixels; what it shows to each side of the middle
OBSERVATIONS = {
    "state": ("state",),
    "screen": ("screen",),
    "fovea": ("fovea",),
    "screen+fovea": ("screen", "fovea"),
    "all": ("state", "screen", "fovea"),
}
PIXELS, REACH = 48, 0.5  # width and height of images; from the marble to the edge of the fovea
BACKGROUND = np.full((PIXELS, PIXELS, 3), (60, 73, 93), np.uint8)
SENSORS = {
    "state": [
        sensor("marble", [2], -1, 1, "x, y"),
        sensor("speed", [2], -1, 1, "x, y, as a fraction of the highest"),
        sensor("ring", [2], -2, 2, "x, y from the marble"),
    ],
    "screen": [image("screen", PIXELS, PIXELS, "the board", channels=3)],
    "fovea": [image("fovea", PIXELS, PIXELS, "a square around the marble", channels=3, centered=True)],
}


class Marble(Game):
    """One board with one marble."""

    name = "marble"
    description = "Tilt the board until the marble lies in the ring: two axes."
    version = "2"
    in_event_loop = True
    options = (
        option(
            "observation",
            list(OBSERVATIONS),
            description="what the hand observes. state: numbers; screen: an image of the board; fovea: one of a square "
            "around the marble; all: everything. An image shows no speed",
        ),
    )

    @classmethod
    def describe(cls, options: Mapping[str, str]) -> pb.GameSpec:
        """Return the spec: two tilts."""
        hand = behavior(
            "hand",
            description="rewarded for being near the middle of the ring, at most 1 per decision",
            sensors=[one for part in OBSERVATIONS[options["observation"]] for one in SENSORS[part]],
            axes=[axis("tilt_x"), axis("tilt_y")],
            metrics=["inside", "lost"],
        )
        return spec(cls, [hand], max_episode_decisions=DECISIONS, tick_seconds=0.05, picture=(SIZE, SIZE))

    def reset(self) -> TimeStep:
        """Begin an episode with the marble at rest in the middle."""
        self.decisions, self.inside = 0, 0
        self.place, self.speed, self.tilt = np.zeros(2), np.zeros(2), np.zeros(2)
        self._move_ring()
        return transition(self._observe())

    def step(self, action: Action) -> TimeStep:
        """Tilt the board and move the marble."""
        self.tilt = np.array([action["tilt_x"], action["tilt_y"]])
        self.speed = ROLLS * self.speed + PULL * self.tilt
        self.place = self.place + self.speed
        lost = bool((np.abs(self.place) > 1).any())
        self.place = self.place.clip(-1, 1)
        distance = float(np.linalg.norm(self.ring - self.place))
        self.inside += distance < RING
        self.decisions += 1
        if self.decisions % RING_DECISIONS == 0:
            self._move_ring()
        rewards = {"reward": max(0.0, 1 - distance)}
        if not lost and self.decisions < DECISIONS:
            return transition(self._observe(), rewards)
        metrics = {"inside": self.inside / DECISIONS, "lost": float(lost)}
        return (termination if lost else truncation)(self._observe(), rewards, metrics)

    def _move_ring(self) -> None:
        self.ring = self.rng.uniform(-0.75, 0.75, 2)

    def _observe(self) -> dict[str, Array]:
        seen: dict[str, Array] = {}
        wanted = OBSERVATIONS[self.option["observation"]]
        if "state" in wanted:
            seen |= {"marble": self.place, "speed": self.speed / FASTEST, "ring": self.ring - self.place}
        if "screen" in wanted:
            seen["screen"] = self._paint(np.zeros(2), VIEW)
        if "fovea" in wanted:
            seen["fovea"] = self._paint(self.place, REACH)
        return seen

    def _paint(self, center: Array, reach: float) -> Array:
        """Return a square of the board: its side that tilt shows, the ring and the marble."""
        canvas = Canvas(BACKGROUND, left=center[0] - reach, top=center[1] + reach, unit=2 * reach / PIXELS)
        side_x, side_y = -self.tilt * 15 / 160
        canvas.box(side_x - 1.08, side_y - 1.08, side_x + 1.08, side_y + 1.08, (136, 92, 56))
        canvas.box(-1.06, -1.06, 1.06, 1.06, (210, 168, 112))
        canvas.disc(self.ring, RING, (246, 230, 186))
        canvas.ring(self.ring, RING - 0.02, 0.04, (190, 60, 50))
        canvas.disc(self.ring, 0.03, (190, 60, 50))
        canvas.disc(self.place, MARBLE, (32, 84, 150))
        return canvas.pixels

    def draw(self) -> Array:
        """Return a picture: the tilted board from above, with the ring and the marble."""
        import pygame  # imported here because only pictures need it

        from joybridge.simulator.render import FINE, disc, fade, fit, picture

        canvas = pygame.Surface((SIZE * FINE, SIZE * FINE))
        frame = fit(*canvas.get_size(), VIEW, VIEW)
        fade(canvas, canvas.get_rect(), (74, 90, 112), (46, 56, 74))
        for layer in range(16):  # its shadow, then from its foot to its top
            x, y = self.tilt * (layer - 15) / 160
            edge = 1.08 if layer else 1.12
            color = (128 + layer, 84 + layer, 48 + layer) if layer else (40, 48, 64)
            pygame.draw.rect(canvas, color, frame.box(x - edge, y - edge, x + edge, y + edge), border_radius=28)
        pygame.draw.rect(canvas, (210, 168, 112), frame.box(-1.06, -1.06, 1.06, 1.06), border_radius=24)
        for grain in range(-9, 10):
            along = np.linspace(-1.04, 1.04, 22)
            line = np.stack([along, grain / 9.2 + 0.02 * np.sin(8 * along + 1.7 * grain)], axis=1)
            pygame.draw.lines(canvas, (196, 152, 98), False, frame.points(line).tolist(), 3)
        ring, marble = frame.points([self.ring, self.place])
        disc(canvas, ring, frame.length(RING), (246, 230, 186))
        disc(canvas, ring, frame.length(RING), (190, 60, 50), 8)
        disc(canvas, ring, frame.length(0.03), (190, 60, 50))
        disc(canvas, marble + np.array([6, 10]), frame.length(MARBLE), (120, 84, 54))
        for layer, color in enumerate(((32, 84, 150), (54, 120, 196), (110, 172, 232), (226, 242, 255))):
            disc(canvas, marble - 3 * layer, frame.length(MARBLE) * (1 - 0.29 * layer), color)
        return picture(canvas)
