"""The obstacles of the seven levels: a tree and a barn as templates, placed, scaled and mirrored.

Lengths are in units of the game: x to the right, y up, (0, 0) at the arena's center. Obstacles hide birds and stop
shots; nothing collides with them.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from joybridge.contract.tensors import Array

Disc = tuple[float, float, float, float]  # x, y, radius, depth
Box = tuple[float, float, float, float, float]  # left, bottom, right, top, depth

BARN_DEPTH, TREE_DEPTH = 0.0, 1.1  # lower is nearer to the viewer

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


@dataclass(frozen=True)
class Placement:
    """A template placed at (x, y) and scaled; a negative scale mirrors it."""

    template: str  # "tree" or "barn"
    x: float
    y: float = 0.0
    scale_x: float = 1.0
    scale_y: float = 1.0


def _tree(x: float, y: float = 0.0, scale_x: float = 1.0, scale_y: float = 1.0) -> Placement:
    return Placement("tree", x, y, scale_x, scale_y)


def _barn(x: float, y: float = 0.0, scale_x: float = 1.0, scale_y: float = 1.0) -> Placement:
    return Placement("barn", x, y, scale_x, scale_y)


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


def _place(placement: Placement) -> tuple[list[Disc], list[Box]]:
    """Return the discs and boxes of one placed template."""
    tree = placement.template == "tree"
    depth = TREE_DEPTH if tree else BARN_DEPTH
    sx, sy = placement.scale_x, placement.scale_y
    radius_scale = max(
        abs(sx), abs(sy)
    )  # the original engine scales discs by the larger of the two, so they stay round
    discs = [(placement.x + sx * x, placement.y + sy * y, radius_scale * r, depth) for x, y, r in TREE_CROWN if tree]
    boxes: list[Box] = []
    for left, bottom, right, top in (TREE_TRUNK,) if tree else BARN_BOXES:
        xs = sorted((placement.x + sx * left, placement.x + sx * right))
        ys = sorted((placement.y + sy * bottom, placement.y + sy * top))
        boxes.append((xs[0], ys[0], xs[1], ys[1], depth))
    return discs, boxes


def build_obstacles() -> Obstacles:
    """Return the obstacles of all seven levels."""
    placed = [[_place(p) for p in level] for level in PLACEMENTS]
    discs = [[disc for ds, _ in level for disc in ds] for level in placed]
    boxes = [[box for _, bs in level for box in bs] for level in placed]
    disc_count = np.array([len(d) for d in discs])
    box_count = np.array([len(b) for b in boxes])
    disc_array = np.zeros((LEVELS, disc_count.max(), 4))
    box_array = np.zeros((LEVELS, box_count.max(), 5))
    for level in range(LEVELS):
        disc_array[level, : disc_count[level]] = np.reshape(discs[level], (-1, 4))
        box_array[level, : box_count[level]] = np.reshape(boxes[level], (-1, 5))
    return Obstacles(disc_array, disc_count, box_array, box_count)


OBSTACLES = build_obstacles()
