"""What agents see of Shooting Birds: bright birds; what hides one from the gun hides it here."""

from dataclasses import replace
from functools import partial

import numpy as np

from joybridge.contract.tensors import Array
from joybridge.games.pictures import Field, Palette, copy_background, paint_bar, paint_disc, paint_ring
from joybridge.games.shooting_birds.levels import BARN_DEPTH, LEVELS, OBSTACLES, TREE_DEPTH, Obstacles
from joybridge.games.shooting_birds.rules import BIRDS, MAGAZINE, WALL_X, WALL_Y
from joybridge.games.shooting_birds.sensing import BIRD_RADIUS
from joybridge.simulator.compiled import compiled

HALF_WIDTH, HALF_HEIGHT = 19.2, 12.0  # of the screen: a little more than the walls enclose

SKY, FAR, NEAR, WALL = range(4)  # kinds of ground: trees are far, and barns near, in the paper's levels
GROUND_GRAYS = [0, 36, 44, 20]
GROUND_COLORS = [(16, 34, 66), (20, 62, 28), (84, 30, 22), (20, 20, 20)]
# Large birds fly in front of everything, medium ones behind what is near, small ones behind everything.
HIDES = np.array([[0, 0, 0, 1], [0, 0, 1, 1], [0, 1, 1, 1]], bool)

CURSOR, AMMO = 3, 4  # things, after the birds by size
GRAYS = [200, 225, 250, 110, 150]
COLORS = [(90, 160, 255), (255, 190, 60), (255, 110, 190), (255, 255, 255), (226, 184, 84)]
CURSOR_RADIUS, CURSOR_OPACITY = 2.2, 160  # wider than any bird, so that none is hidden in it
OPAQUE = 256


def ground(obstacles: Obstacles, beyond: float, level: int, x: Array, y: Array) -> Array:
    """Return what is nearest to the viewer at places x [w], y [h] of a level, uint8 [h, w].

    beyond: units of the field on both sides of the screen in the middle.
    """
    kinds = np.full((len(y), len(x)), SKY, np.uint8)
    boxes = obstacles.boxes[level, : obstacles.box_count[level]]
    discs = obstacles.discs[level, : obstacles.disc_count[level]]
    for depth, kind in ((TREE_DEPTH, FAR), (BARN_DEPTH, NEAR)):
        for left, bottom, right, top, _ in boxes[boxes[:, 4] == depth]:
            kinds[_within(-y, -top, -bottom), _within(x, left, right)] = kind
        for center_x, center_y, radius, _ in discs[discs[:, 3] == depth]:
            rows = _within(-y, -center_y - radius, -center_y + radius)
            columns = _within(x, center_x - radius, center_x + radius)
            inside = (x[columns] - center_x) ** 2 + ((y[rows] - center_y) ** 2)[:, None] <= radius * radius
            kinds[rows, columns][inside] = kind
    kinds[:, np.abs(x) > WALL_X + beyond] = WALL
    kinds[np.abs(y) > WALL_Y] = WALL
    return kinds


def _within(increasing: Array, low: float, high: float) -> slice:
    """Return where increasing values are within low..high."""
    return slice(np.searchsorted(increasing, low, "left"), np.searchsorted(increasing, high, "right"))


FIELD = Field(
    HALF_WIDTH,
    HALF_HEIGHT,
    LEVELS,
    partial(ground, OBSTACLES, 0.0),
    HIDES,
    Palette(GROUND_GRAYS, GRAYS),
    Palette(GROUND_COLORS, COLORS),
)


def field_of(obstacles: Obstacles, levels: int, beyond: float) -> Field:
    """Return the field with other obstacles, those of so many levels, on further screens too if `beyond` is not 0."""
    return replace(FIELD, half_width=HALF_WIDTH + beyond, levels=levels, ground=partial(ground, obstacles, beyond))


@compiled
def paint(arenas, travels, eye, cursor, canvases):
    """Paint what every arena's agent sees into `canvases`, uint8 [arenas, height, width, channels].

    travels: whether the arenas have a camera that moves, so that nothing is seen beyond the border of its screen.
    """
    order = np.empty(BIRDS, np.int64)
    for i in range(len(arenas)):
        arena, canvas = arenas[i], canvases[i]
        if eye.on_camera:
            window = copy_background(eye, arena.level, arena.camera, 0.0, canvas)
        else:
            window = copy_background(eye, arena.level, arena.x, arena.y, canvas)
        _sort_by_depth(arena.birds, order)
        for j in order:
            bird = arena.birds[j]
            paint_disc(eye, window, bird.kind, bird.x, bird.y, BIRD_RADIUS[bird.kind], bird.kind, OPAQUE, canvas)
        if travels:
            _cover_sides(eye, window, arena.camera, canvas)
        if cursor:
            paint_ring(eye, window, arena.x, arena.y, CURSOR_RADIUS, CURSOR, CURSOR_OPACITY, canvas)
        paint_bar(eye, 0, canvas.shape[1], arena.ammo / MAGAZINE, AMMO, canvas)


@compiled
def _cover_sides(eye, window, middle, canvas):
    """Paint what lies to the left and to the right of the screen around `middle`."""
    height, width, channels = canvas.shape
    for j in range(width):
        if abs(window.left + (j + 0.5) * eye.unit - middle) > WALL_X:
            for i in range(height):
                for c in range(channels):
                    canvas[i, j, c] = eye.ground_colors[WALL, c]


@compiled
def _sort_by_depth(birds, order):
    """Write the indices of the birds into `order`, the farthest first."""
    for j in range(len(birds)):
        k = j
        while k > 0 and birds[order[k - 1]].z < birds[j].z:
            order[k] = order[k - 1]
            k -= 1
        order[k] = j
