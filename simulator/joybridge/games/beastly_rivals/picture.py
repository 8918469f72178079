"""What agents see of Beastly Rivals, from above: the beast kills when its disc touches that of the character."""

from dataclasses import replace
from functools import partial

import numpy as np

from joybridge.contract.tensors import Array
from joybridge.games.beastly_rivals.pitches import BOUNDARY_RADIUS, PITCH_RADIUS, Pitches, make_pitches
from joybridge.games.beastly_rivals.rules import (
    BOX_AHEAD,
    BOX_HALF,
    CHARACTER_RADIUS,
    COOLDOWN_TICKS,
    SPEED_LIMIT,
)
from joybridge.games.pictures import Field, Palette, copy_background, paint_bar, paint_disc, paint_ring
from joybridge.simulator.compiled import compiled

HALF = 8.3  # of the screen: a little more than the pitch

GRASS, FOREST, PILLAR = range(3)  # kinds of ground
GROUND_GRAYS = [0, 20, 44]
GROUND_COLORS = [(24, 58, 24), (12, 20, 20), (84, 80, 76)]

SPHERE, GOAL, CHARACTER, BEAST, FAR_BEAST, CURSOR, COOLING, READY, ANGER = range(9)  # things
GRAYS = [120, 100, 200, 250, 160, 110, 90, 200, 150]
COLORS = [
    (146, 124, 250),
    (250, 190, 70),
    (70, 140, 255),
    (255, 60, 40),
    (160, 40, 30),
    (255, 255, 255),
    (60, 110, 120),
    (92, 225, 240),
    (232, 60, 50),
]
BEAST_RADIUS = BOX_AHEAD + BOX_HALF
GOAL_RADIUS, FAR_RADIUS = 0.2, 0.4
CURSOR_RADIUS, CURSOR_OPACITY = 0.8, 160  # wider than character and beast, so that none is hidden in it
TRANSLUCENT, OPAQUE = 85, 256


def ground(pitches: Pitches, level: int, x: Array, y: Array) -> Array:
    """Return grass, forest or pillar at places x [w], y [h] of a pitch, uint8 [h, w]."""
    column = y[:, None]
    kinds = np.where(x * x + column * column <= PITCH_RADIUS * PITCH_RADIUS, GRASS, FOREST).astype(np.uint8)
    bank = PITCH_RADIUS - BOUNDARY_RADIUS  # also outside the edges
    for across, along, distance in pitches.edges[level, : pitches.edge_counts[level]]:
        kinds[across * x + along * column > distance + bank] = FOREST
    for center_x, center_y, radius in pitches.pillars[level, : pitches.pillar_counts[level]]:
        kinds[(x - center_x) ** 2 + (column - center_y) ** 2 <= radius * radius] = PILLAR
    return kinds


HIDES = np.zeros((1, 3), bool)  # everything is on the ground
FIELD = Field(
    HALF, HALF, 1, partial(ground, make_pitches(1)), HIDES, Palette(GROUND_GRAYS, GRAYS), Palette(GROUND_COLORS, COLORS)
)


def field_of(pitches: Pitches, levels: int) -> Field:
    """Return the field with other pitches, so many."""
    return replace(FIELD, levels=levels, ground=partial(ground, pitches))


@compiled
def paint(arenas, pitches, eye, cursor, canvases):
    """Paint what every arena's agent sees into `canvases`, uint8 [arenas, height, width, channels]."""
    for i in range(len(arenas)):
        arena, canvas = arenas[i], canvases[i]
        pointer, sphere, beast = arena.cursor, arena.sphere, arena.beast
        window = copy_background(eye, arena.level, pointer.x, pointer.z, canvas)
        sphere_radius = pitches.sphere[arena.level, 0]
        paint_disc(eye, window, 0, sphere.x, sphere.z, sphere_radius, SPHERE, TRANSLUCENT, canvas)
        if arena.moving:
            paint_disc(eye, window, 0, arena.goal_x, arena.goal_z, GOAL_RADIUS, GOAL, OPAQUE, canvas)
        body = arena.character
        paint_disc(eye, window, 0, body.x, body.z, CHARACTER_RADIUS, CHARACTER, OPAQUE, canvas)
        paint_disc(eye, window, 0, beast.x, beast.z, BEAST_RADIUS, BEAST, OPAQUE, canvas)
        far = max(abs(beast.x), abs(beast.z))
        if not eye.centered and far > HALF + BEAST_RADIUS:  # it is outside the picture: mark its direction at the edge
            near = (HALF - FAR_RADIUS) / far
            paint_disc(eye, window, 0, beast.x * near, beast.z * near, FAR_RADIUS, FAR_BEAST, OPAQUE, canvas)
        if cursor:
            paint_ring(eye, window, pointer.x, pointer.z, CURSOR_RADIUS, CURSOR, CURSOR_OPACITY, canvas)
        middle, ready = canvas.shape[1] // 2, arena.cooldown == 0
        color = READY if ready else COOLING
        paint_bar(eye, 0, middle, 1.0 - arena.cooldown / COOLDOWN_TICKS, color, canvas)
        paint_bar(eye, middle, canvas.shape[1], min(arena.speed / SPEED_LIMIT, 1.0), ANGER, canvas)
