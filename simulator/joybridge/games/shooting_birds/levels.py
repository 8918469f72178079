"""The seven levels: a tree and a barn as templates, placed, scaled and mirrored, and how birds enter.

Lengths are in units of the game: x to the right, y up, (0, 0) at the arena's center. Obstacles hide birds and stop
shots; nothing collides with them.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from joybridge.contract.tensors import Array

BARN_DEPTH, TREE_DEPTH = 0.0, 1.1  # lower is nearer to the viewer
SPAWN_LOW, SPAWN_HIGH = -8.48, 8.26
SLOWEST, FASTEST = 1.5, 6.0

# Each template box is (left, bottom, right, top), each disc (x, y, radius).
TREE_TRUNK = (-1.3, -13.95, 1.3, -1.17)
TREE_CROWN = (
    (-2.06, 2.76, 2.66),
    (2.24, 2.94, 3.0),
    (2.81, -0.22, 2.04),
    (-0.46, 0.7, 2.8),
    (-3.2, -0.39, 2.1),
)
BARN_BOXES = (
    (-6.45, 3.375, -3.55, 4.925),  # chimney
    (-8.45, -5.51, -0.75, 3.47),  # upper wall, left
    (2.15, -5.51, 8.85, 3.47),  # upper wall, right
    (-0.745, -0.09, 2.165, 3.47),  # above the window
    (-0.745, -5.51, 2.165, -1.79),  # below the window
    (-8.025, -10.035, 8.575, -8.965),  # foot
    (-8.025, -6.4, 8.575, -5.5),  # beam
    (-0.575, -8.945, 1.175, -6.435),  # posts of the ground floor, with open doors between them
    (-4.525, -8.96, -2.775, -6.42),
    (3.325, -8.96, 5.075, -6.42),
    (7.13, -8.96, 8.57, -6.42),
    (-8.015, -8.96, -6.715, -6.42),
)
BUSH_CROWN = ((-1.7, 0.9, 1.2), (0.1, 1.2, 1.7), (1.8, 0.8, 1.1))  # only in generated levels

TREE, BARN, BUSH = range(3)
_NO_DISCS, _NO_BOXES = np.zeros((0, 3)), np.zeros((0, 4))
DISCS = (np.array(TREE_CROWN), _NO_DISCS, np.array(BUSH_CROWN))  # by template
BOXES = (np.array([TREE_TRUNK]), np.array(BARN_BOXES), _NO_BOXES)


@dataclass(frozen=True)
class Placement:
    """A template placed at (x, y) and scaled; a negative scale mirrors it."""

    template: int
    x: float
    y: float = 0.0
    scale_x: float = 1.0
    scale_y: float = 1.0
    depth: float = BARN_DEPTH


def _tree(x: float, y: float = 0.0, scale_x: float = 1.0, scale_y: float = 1.0) -> Placement:
    return Placement(TREE, x, y, scale_x, scale_y, TREE_DEPTH)


def _barn(x: float, y: float = 0.0, scale_x: float = 1.0, scale_y: float = 1.0) -> Placement:
    return Placement(BARN, x, y, scale_x, scale_y)


PLACEMENTS: tuple[tuple[Placement, ...], ...] = (
    (_tree(-10.27), _barn(8.75)),
    (_tree(10.27, scale_x=-1.0), _barn(-8.75, scale_x=-1.0)),
    (_tree(-14.34), _barn(0.0), _tree(14.34, scale_x=-1.0)),
    (
        _tree(-3.72, -0.375, 0.75, 0.75),
        _tree(9.01, 1.44, scale_x=-1.0),
        _tree(-13.29, 0.4945, -0.75, 0.985),
        _tree(-1.3, -9.31),
        _tree(-5.52, -9.31, scale_x=-1.0),
    ),
    (_tree(-10.27, 3.47), _barn(6.64, 1.73, 1.2, 1.2)),
    (_barn(0.0, 2.705, 1.3, 1.3),),
    (_barn(0.0, 22.3875, 2.25, 2.25), _barn(0.0, -22.3875, 2.25, -2.25)),
)
LEVELS = len(PLACEMENTS)


class Obstacles(NamedTuple):
    """The obstacles of all levels as arrays for compiled code. Rows beyond the count of a level are unused."""

    discs: Array  # float64 [levels, most, 4]: x, y, radius, depth
    disc_count: Array  # int64 [levels]
    boxes: Array  # float64 [levels, most, 5]: left, bottom, right, top, depth
    box_count: Array  # int64 [levels]


# How birds enter a level.
FLIGHT = np.dtype(
    [
        ("lines", "f8", (3, 2)),
        ("line_count", "i8"),  # lowest and highest place of birds that enter on a flight line
        ("large", "f8"),
        ("medium", "f8"),  # shares of large, and of large and medium birds
        ("slowest", "f8"),
        ("fastest", "f8"),  # units/s
        ("pause", "f8"),  # s, mean time until a bird that was shot or has left enters again
    ]
)


def no_obstacles(levels: int, discs: int, boxes: int) -> Obstacles:
    """Return levels without an obstacle, with room for so many discs and boxes each."""
    counts = np.zeros((2, levels), np.int64)
    return Obstacles(np.zeros((levels, discs, 4)), counts[0], np.zeros((levels, boxes, 5)), counts[1])


def place(obstacles, level, template_discs, template_boxes, placement):
    """Add the discs and boxes of a template to a level. placement: x, y, scale_x, scale_y, depth."""
    x, y, scale_x, scale_y, depth = placement
    radius_scale = max(abs(scale_x), abs(scale_y))  # as the original engine does, so that discs stay round
    for j in range(len(template_discs)):
        disc = obstacles.discs[level, obstacles.disc_count[level]]
        disc[0], disc[1] = x + scale_x * template_discs[j, 0], y + scale_y * template_discs[j, 1]
        disc[2], disc[3] = radius_scale * template_discs[j, 2], depth
        obstacles.disc_count[level] += 1
    for j in range(len(template_boxes)):
        box = obstacles.boxes[level, obstacles.box_count[level]]
        x0, x1 = x + scale_x * template_boxes[j, 0], x + scale_x * template_boxes[j, 2]
        y0, y1 = y + scale_y * template_boxes[j, 1], y + scale_y * template_boxes[j, 3]
        box[0], box[1], box[2], box[3], box[4] = min(x0, x1), min(y0, y1), max(x0, x1), max(y0, y1), depth
        obstacles.box_count[level] += 1


def placements_of(level: int, screens: int, screen_width: float) -> tuple[Placement, ...]:
    """Return what stands in a level. On further screens beside it stands what stands in its neighbors."""
    sides = range(-(screens // 2), screens // 2 + 1)
    return tuple(
        replace(placement, x=placement.x + side * screen_width)
        for side in sides
        for placement in PLACEMENTS[(level + side) % LEVELS]
    )


def build_obstacles(screens: int = 1, screen_width: float = 0.0) -> Obstacles:
    """Return the obstacles of all seven levels."""
    obstacles = no_obstacles(LEVELS, 25 * screens, 24 * screens)
    for level in range(LEVELS):
        for p in placements_of(level, screens, screen_width):
            place(obstacles, level, DISCS[p.template], BOXES[p.template], (p.x, p.y, p.scale_x, p.scale_y, p.depth))
    return obstacles


def build_flights() -> Array:
    """Return how birds enter the seven levels: alike."""
    flights = np.zeros(LEVELS, FLIGHT)
    flights["lines"][:, 0] = SPAWN_LOW, SPAWN_HIGH
    flights["line_count"], flights["large"], flights["medium"] = 1, 1 / 3, 2 / 3
    flights["slowest"], flights["fastest"] = SLOWEST, FASTEST
    return flights.view(np.recarray)


OBSTACLES, FLIGHTS = build_obstacles(), build_flights()
