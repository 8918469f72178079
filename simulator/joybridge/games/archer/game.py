"""Archer: aim a bow ahead of a rising balloon while drawing the string, then loose the arrow.

A continuous and a discrete action at once. The choices are masked: they depend on how far the string is drawn.
"""

import math
from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from joybridge.contract.tensors import Array
from joybridge.simulator import (
    Action,
    Game,
    TimeStep,
    axis,
    behavior,
    branch,
    image,
    option,
    parameter,
    sensor,
    spec,
    termination,
    transition,
    truncation,
)
from joybridge.simulator.canvas import Canvas
from joybridge.v1 import bridge_pb2 as pb

DECISIONS = 120  # per episode, at most
ARROWS = 10
REST, DRAW, LOOSE = range(3)  # choices of the branch "string"
PULLS = 3  # decisions to draw the string
FLIGHT = 4  # decisions an arrow takes, fewer than drawing and loosing the next
STEEPEST, TURN = 1.25, 0.2  # of the bow: highest slope, largest change per decision
DROP = 0.02  # how much an arrow's climb decreases per decision
FASTEST = 0.06  # rise of a balloon per decision
RADIUS = 0.09  # of a balloon of size 1; the sky is 1 high, and an arrow flies a distance of 1
WIDTH, HEIGHT = 360, 240
FAR, SKY = 250, 145  # how many pixels of the picture an arrow flies, and how high the sky is
ROWS, COLUMNS = 32, 48  # of the image that an archer sees
BACKGROUND = np.full((ROWS, COLUMNS, 3), (252, 214, 180), np.uint8)
BACKGROUND[30:] = 118, 142, 96
SENSORS = {
    "state": [
        sensor("bow", [3], 0, 1, "slope, string, arrows left"),
        sensor("arrow", [1], 0, 1, "fraction of its flight that is left; 0: no arrow in the air"),
        sensor("balloon", [2], 0, 1, "height, speed"),
    ],
    "screen": [image("screen", ROWS, COLUMNS, "the whole sky", channels=3)],
}


class Archer(Game):
    """One archer under one sky."""

    name = "archer"
    description = "Aim ahead of the balloons and loose the arrow in time: an axis, and choices that are masked."
    version = "2"
    in_event_loop = True
    options = (
        option("observation", list(SENSORS), description="what the archer sees: numbers, or an image without speed"),
    )

    @classmethod
    def describe(cls, options: Mapping[str, str]) -> pb.GameSpec:
        """Return the spec: an axis turns the bow, a branch controls the string."""
        archer = behavior(
            "archer",
            description="reward 1 for each balloon",
            sensors=SENSORS[options["observation"]],
            axes=[axis("turn")],
            branches=[
                branch(
                    "string",
                    ["rest", "draw", "loose"],
                    "draw until the string is fully drawn; only then loose is allowed",
                )
            ],
            metrics=["hits", "accuracy"],
        )
        return spec(
            cls,
            [archer],
            parameters=[parameter("size", 0.1, 4.0, 1.0, "factor on the radius of balloons")],
            max_episode_decisions=DECISIONS,
            tick_seconds=0.1,
            picture=(WIDTH, HEIGHT),
        )

    def reset(self) -> TimeStep:
        """Begin an episode with all arrows and a balloon on the ground."""
        self.decisions, self.hits, self.arrows, self.pulls, self.slope = 0, 0, ARROWS, 0, 0.5
        self.flight, self.height, self.climb = 0, 0.0, 0.0  # of the arrow in the air: decisions left, height, speed
        self._release_balloon()
        return transition(self._observe(), masks=self._masks())

    def step(self, action: Action) -> TimeStep:
        """Turn the bow, draw or loose, then move arrow and balloon."""
        self.decisions += 1
        self.slope = min(STEEPEST, max(0.0, self.slope + TURN * action["turn"]))
        if action["string"] == DRAW:
            self.pulls += 1
        elif action["string"] == LOOSE:
            self.pulls, self.arrows = 0, self.arrows - 1
            self.flight, self.height, self.climb = FLIGHT, 0.0, self.slope / FLIGHT
        self.balloon += self.rise
        hit = self._arrow_hits()
        self.hits += hit
        if hit or self.balloon > 1:
            self._release_balloon()
        rewards, spent = {"reward": float(hit)}, not self.arrows and not self.flight
        if not spent and self.decisions < DECISIONS:
            return transition(self._observe(), rewards, self._masks())
        loosed = ARROWS - self.arrows
        metrics = {"hits": self.hits, "accuracy": self.hits / max(1, loosed)}
        return (termination if spent else truncation)(self._observe(), rewards, metrics)

    def _arrow_hits(self) -> bool:
        """Move the arrow and return whether it hits the balloon now."""
        if not self.flight:
            return False
        self.flight, self.climb = self.flight - 1, self.climb - DROP
        self.height += self.climb
        return not self.flight and abs(self.height - self.balloon) < RADIUS * self.parameter["size"]

    def _release_balloon(self) -> None:
        self.balloon, self.rise = 0.0, float(self.rng.uniform(0.02, FASTEST))

    def _masks(self) -> dict[str, list[bool]]:
        drawn = self.pulls == PULLS
        return {"string": [True, not drawn and self.arrows > 0, drawn]}

    def _observe(self) -> Mapping[str, npt.ArrayLike]:
        if self.option["observation"] == "screen":
            return {"screen": self._paint()}
        return {
            "bow": [self.slope / STEEPEST, self.pulls / PULLS, self.arrows / ARROWS],
            "arrow": [self.flight / FLIGHT],
            "balloon": [self.balloon, self.rise / FASTEST],
        }

    def _paint(self) -> Array:
        """Return what the archer sees: the balloon, the arrows in the air and left, and the bow with its string."""
        canvas = Canvas(BACKGROUND, left=-60, top=170, unit=WIDTH / COLUMNS)
        canvas.disc((FAR, SKY * self.balloon), SKY * RADIUS * self.parameter["size"], (226, 62, 74))
        if self.flight:
            x, y = FAR * (1 - self.flight / FLIGHT), SKY * self.height
            east, north = _direction(FAR / FLIGHT, SKY * self.climb)
            canvas.line((x - 28 * east, y - 28 * north), (x + 6 * east, y + 6 * north), 5, (84, 62, 48))
        canvas.box(-52, 140, -52 + 10 * self.arrows, 156, (84, 62, 48))
        east, north = _direction(FAR, SKY * self.slope)
        pull = 7 + 6 * self.pulls
        nock = -pull * east, -pull * north
        for side in (-31, 31):
            end = -7 * east - side * north, -7 * north + side * east
            canvas.line(nock, end, 3, (255, 255, 255))
            canvas.line((4 * east, 4 * north), end, 8, (122, 78, 44))
        if self.pulls:
            canvas.line(nock, ((34 - pull) * east, (34 - pull) * north), 5, (58, 60, 70))
        return canvas.pixels

    def draw(self) -> Array:
        """Return a picture: the archer, the string, the flying arrow, the balloon and the arrows that are left."""
        import pygame  # imported here because only pictures need it

        from joybridge.simulator.render import FINE, Frame, block, disc, fade, picture, shape, write

        canvas = pygame.Surface((WIDTH * FINE, HEIGHT * FINE))
        # Pixels of the picture, y up, from the hand that holds the bow; balloons rise at x = 250 from y = 0 to 145.
        frame = Frame(np.array([60, 170]) * FINE, np.diag([FINE, -FINE]))
        fade(canvas, canvas.get_rect(), (250, 188, 146), (253, 240, 214))
        disc(canvas, frame.points([(140, 105)])[0], 46, (255, 248, 226))
        pygame.draw.ellipse(canvas, (206, 186, 172), frame.box(55, -160, 375, -10))
        pygame.draw.ellipse(canvas, (150, 164, 122), frame.box(-150, -174, 170, -24))
        block(canvas, frame, (-60, -70, 300, -50), (118, 142, 96))

        def line(place: Frame, points: npt.ArrayLike, width: int, color: tuple[int, int, int]) -> None:
            pygame.draw.lines(canvas, color, False, place.points(points).tolist(), width)

        def arrow(place: Frame) -> None:
            line(place, [(-28, 0), (0, 0)], 5, (84, 62, 48))
            shape(canvas, place, [(6, 0), (0, 4), (0, -4)], (58, 60, 70))
            shape(canvas, place, [(-32, 4), (-26, 2), (-26, -2), (-32, -4), (-28, 0)], (214, 68, 60))

        balloon = frame.placed(FAR, SKY * self.balloon)
        line(balloon, [(0, -15), (2, -26), (-1, -38)], 3, (120, 96, 90))
        shape(canvas, balloon, [(0, -12), (4, -20), (-4, -20)], (196, 44, 58))
        disc(canvas, balloon.origin, FINE * (SKY * RADIUS * self.parameter["size"] + 2), (226, 62, 74))
        disc(canvas, balloon.points([(-4, 5)])[0], 7, (252, 176, 172))
        if self.flight:
            flown, turn = 1 - self.flight / FLIGHT, np.arctan2(SKY * self.climb, FAR / FLIGHT)
            arrow(frame.placed(FAR * flown, SKY * self.height, turn=turn))
        for left in range(self.arrows):
            arrow(frame.placed(8 * left - 46, 156, turn=np.pi / 2))

        turn, pull = np.arctan2(SKY * self.slope, FAR), 7 + 6 * self.pulls
        bow = frame.placed(0, 0, turn=turn)
        for foot in (-31, -18):
            line(frame, [(-23, -26), (foot, -57)], 12, (86, 66, 56))
        shape(canvas, frame, [(-29, 11), (-16, 11), (-11, -32), (-35, -32)], (58, 110, 78))
        disc(canvas, frame.points([(-22, 22)])[0], 20, (240, 204, 172))
        shape(canvas, frame, [(-36, 24), (-4, 26), (-22, 39)], (58, 110, 78))
        for hand in ((0, 0), (-pull * np.cos(turn), -pull * np.sin(turn))):
            line(frame, [(-22, 5), hand], 11, (74, 132, 92))
            disc(canvas, frame.points([hand])[0], 7, (240, 204, 172))
        limb = [(4 - 11 * y * y, 31 * y) for y in np.linspace(-1, 1, 15)]
        line(bow, [limb[0], (-pull, 0), limb[-1]], 3, (250, 250, 250))
        line(bow, limb, 8, (122, 78, 44))
        if self.pulls:
            arrow(bow.placed(28 - pull, 0))
        write(canvas, f"{self.hits} of {ARROWS - self.arrows}", 36, (236, 240, 222), WIDTH * FINE - 20, 460, align=1.0)
        return picture(canvas)


def _direction(x: float, y: float) -> tuple[float, float]:
    """Return a vector of length 1, without functions whose last bit differs between machines."""
    length = math.sqrt(x * x + y * y)
    return x / length, y / length
