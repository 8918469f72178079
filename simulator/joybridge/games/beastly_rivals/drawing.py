"""Pictures of Beastly Rivals Onslaught: the pitch from above, x to the right and z up, and a panel.

The beast's muzzle ends where its collider does: the beast kills exactly when the muzzle touches the character.
"""

from functools import lru_cache

import numpy as np
import pygame

from joybridge.contract.tensors import Array
from joybridge.games.beastly_rivals.pitches import BOUNDARY_RADIUS, PITCH_RADIUS, Pitches
from joybridge.games.beastly_rivals.rules import (
    CHARACTER_SPEED,
    CLOCK_TICKS,
    COOLDOWN_TICKS,
    SPEED_LIMIT,
    TICK,
)
from joybridge.games.figures import BOOT, Clothes, beast, cursor, person
from joybridge.games.painting import (
    AMBER,
    BANK,
    BANK_DARK,
    BAR,
    BLADE,
    BLADE_LIGHT,
    BLINK,
    BLOOD,
    CHALK,
    DIM,
    FAINT,
    GRASS_DARK,
    GRASS_LIGHT,
    GROOVE,
    INK,
    LEAVES,
    LEAVES_LIGHT,
    NIGHT,
    PALE,
    PANEL,
    PANEL_EDGE,
    WHITE,
    WOOD,
    WOOD_SHADE,
    arc,
    bar,
    disc,
    haze,
    line,
    mix,
    ring,
)
from joybridge.simulator.render import FINE, Frame, fit, picture, shape, write

VIEW_RADIUS = 8.3  # units shown to each side of the pitch's center
SHARE = 0.75  # of the picture's width that shows the pitch; the rest is the panel

SLOW = (146, 124, 250)
STONE_DARK, STONE, STONE_LIGHT = (78, 76, 74), (128, 124, 118), (158, 154, 146)
TUNIC = Clothes((44, 104, 222), (28, 66, 150))


def draw(arena: np.record, pitches: Pitches, width: int, height: int) -> Array:
    """Return a picture, uint8 [height, width, 3], of one arena, a record of dtype ARENA, on its pitch."""
    canvas = pygame.Surface((width * FINE, height * FINE), depth=32)
    canvas.blit(_scenery(*canvas.get_size()), (0, 0))
    world = _world(*canvas.get_size())
    level = int(arena.level)
    _beyond(canvas, world, pitches.edges[level, : pitches.edge_counts[level]])
    _pillars(canvas, world, pitches.pillars[level, : pitches.pillar_counts[level]])
    _sphere(canvas, world, arena, float(pitches.sphere[level, 0]))
    _goal(canvas, world, arena)
    _character(canvas, world, arena)
    _beast(canvas, world, arena)
    _arrow_to_beast(canvas, world, arena)
    cursor(canvas, world.placed(arena.cursor.x, arena.cursor.z))
    _panel(canvas, arena)
    return picture(canvas)


def _world(width: int, height: int) -> Frame:
    return fit(round(width * SHARE), height, VIEW_RADIUS, VIEW_RADIUS)


@lru_cache(maxsize=8)
def _scenery(width: int, height: int) -> pygame.Surface:
    """Return the background: a forest at night, and the pitch in it."""
    canvas = pygame.Surface((width, height), depth=32)
    canvas.fill(WOOD)
    world, random = _world(width, height), np.random.default_rng(7)
    for angle, distance, size, tone in random.uniform((0, 8.35, 0.25, 0), (2 * np.pi, 12.5, 0.6, 1), (420, 4)):
        tree = world.placed(distance * np.cos(angle), distance * np.sin(angle), size, size)
        disc(canvas, tree, WOOD_SHADE, 1.08, 0.2, -0.25)
        disc(canvas, tree, mix(WOOD, LEAVES, tone), 1.0)
        disc(canvas, tree, mix(LEAVES, LEAVES_LIGHT, tone), 0.5, -0.25, 0.3)
    disc(canvas, world, BANK_DARK, PITCH_RADIUS + 0.45)
    disc(canvas, world, BANK, PITCH_RADIUS + 0.3)
    for band in range(8):
        disc(canvas, world, GRASS_LIGHT if band % 2 else GRASS_DARK, PITCH_RADIUS * (8 - band) / 8)
    for angle, share, tall, tone in random.uniform((0, 0, 0.06, 0), (2 * np.pi, 1, 0.16, 1), (900, 4)):
        distance = PITCH_RADIUS * np.sqrt(share)
        blade = world.placed(distance * np.cos(angle), distance * np.sin(angle))
        line(canvas, blade, mix(BLADE, BLADE_LIGHT, tone), [(0.0, 0.0), (0.04, tall)], 0.04)
    ring(canvas, world, CHALK, BOUNDARY_RADIUS, 0.07)
    ring(canvas, world, mix(GRASS_LIGHT, CHALK, 0.45), 1.1, 0.05)
    disc(canvas, world, mix(GRASS_LIGHT, CHALK, 0.6), 0.1)
    haze(canvas, world, NIGHT, 9.2, 0, 150, clear=0.62)
    return canvas


def _beyond(canvas: pygame.Surface, world: Frame, edges: Array) -> None:
    """Draw the edges of a generated pitch like its boundary, and let the forest grow beyond them."""
    random, outer = np.random.default_rng(8), PITCH_RADIUS + 0.45
    frames = [world.placed(0.0, 0.0, turn=np.arctan2(z, x)).placed(distance, 0.0) for x, z, distance in edges.tolist()]
    for frame, distance in zip(frames, edges[:, 2].tolist(), strict=True):
        half = np.sqrt(BOUNDARY_RADIUS**2 - distance**2)
        line(canvas, frame, CHALK, [(0.0, -half), (0.0, half)], 0.07)
        for begin, color in ((0.375, BANK), (0.675, BANK_DARK)):
            half = np.sqrt(max(outer**2 - (distance + begin) ** 2, 0.0))
            strip = ((begin, -half), (begin + 0.3, -half), (begin + 0.3, half), (begin, half))
            shape(canvas, frame, strip, color)
    for frame, distance in zip(frames, edges[:, 2].tolist(), strict=True):
        deep = outer - distance
        half = np.sqrt(outer**2 - distance**2) + 0.1
        shape(canvas, frame, ((0.825, -half), (deep, -half), (deep, half), (0.825, half)), WOOD)
        places = random.uniform((1.1, -half, 0.2, 0), (max(deep, 1.2), half, 0.5, 1), (round(22 * deep), 4))
        for out, along, size, tone in places:
            tree = frame.placed(out, along, size, size)
            disc(canvas, tree, WOOD_SHADE, 1.08, 0.2, -0.25)
            disc(canvas, tree, mix(WOOD, LEAVES, tone), 1.0)
            disc(canvas, tree, mix(LEAVES, LEAVES_LIGHT, tone), 0.5, -0.25, 0.3)


def _pillars(canvas: pygame.Surface, world: Frame, pillars: Array) -> None:
    """Paint round pillars of stone with a shadow."""
    for x, z, radius in pillars.tolist():
        frame = world.placed(x, z)
        haze(canvas, frame.placed(0.15, -0.18), INK, 1.25 * radius, 170, 0, clear=0.6)
        disc(canvas, frame, STONE_DARK, radius)
        disc(canvas, frame, STONE, 0.82 * radius, -0.05 * radius, 0.06 * radius)
        disc(canvas, frame, STONE_LIGHT, 0.5 * radius, -0.12 * radius, 0.14 * radius)


def _sphere(canvas: pygame.Surface, world: Frame, arena: np.record, radius: float) -> None:
    """Paint a translucent dome with three slowly turning arcs."""
    frame = world.placed(arena.sphere.x, arena.sphere.z)
    haze(canvas, frame, SLOW, radius, 60, 165, clear=0.35)
    haze(canvas, frame.placed(-radius / 3.0, 1.15 * radius / 3.0), WHITE, 0.4 * radius, 70, 0)
    ring(canvas, frame, mix(SLOW, WHITE, 0.5), radius, 0.07)
    for k in range(3):
        arc(
            canvas, frame, mix(SLOW, WHITE, 0.25), 2.3 * radius / 3.0, 0.6 * arena.clock * TICK + k * 2 * np.pi / 3, 1.1
        )


def _goal(canvas: pygame.Surface, world: Frame, arena: np.record) -> None:
    """Paint a flag at the goal of a walking character, and dots on the way there."""
    if not arena.moving:
        return
    flag, start = world.placed(arena.goal_x, arena.goal_z), world.placed(arena.character.x, arena.character.z)
    way = np.array([arena.goal_x - arena.character.x, arena.goal_z - arena.character.z])
    for distance in np.arange(0.7, np.hypot(*way) - 0.2, 0.35):
        disc(canvas, start, CHALK, 0.05, *(way * distance / np.hypot(*way)))
    haze(canvas, flag.placed(0.06, 0.0), INK, 0.2, 120, 0)
    line(canvas, flag, BOOT, [(0.0, 0.0), (0.0, 0.7)], 0.08)
    shape(canvas, flag, ((0.03, 0.7), (0.5, 0.53), (0.03, 0.34)), AMBER, INK)


def _character(canvas: pygame.Surface, world: Frame, arena: np.record) -> None:
    """Paint the character. The ring around it fills during the cooldown of blink and glows when blink is ready."""
    body, ready = arena.character, arena.cooldown == 0
    still = body.vx == 0.0 and body.vz == 0.0  # then it looks at the beast
    turn = np.arctan2(arena.beast.z - body.z, arena.beast.x - body.x) if still else np.arctan2(body.vz, body.vx)
    place = world.placed(body.x, body.z)
    haze(canvas, place.placed(0.1, -0.12), INK, 0.55, 150, 0, clear=0.3)
    if ready:
        haze(canvas, place, BLINK, 0.95, 130, 0, clear=0.3)
    ring(canvas, place, mix(GRASS_DARK, INK, 0.5), 0.54, 0.09)
    filled = 2 * np.pi * (1.0 - arena.cooldown / COOLDOWN_TICKS)
    arc(canvas, place, BLINK if ready else mix(BLINK, DIM, 0.35), 0.5, np.pi / 2, -filled)
    frame = world.placed(body.x, body.z, turn=turn)
    stride = 0.0 if still else 0.14 * np.sin(25.0 * arena.clock * TICK)
    person(canvas, frame, TUNIC, stride)


def _beast(canvas: pygame.Surface, world: Frame, arena: np.record) -> None:
    """Paint the beast, turned to the character, in a color that shows its speed."""
    body, character = arena.beast, arena.character
    anger = min(arena.speed / SPEED_LIMIT, 1.0)
    for k in range(6, 0, -1):  # a trail of dust, then of embers
        puff = world.placed(body.x - 0.06 * k * body.vx, body.z - 0.06 * k * body.vz)
        haze(canvas, puff, mix(BOOT, BLOOD, round(round(anger, 2), 1)), 0.75 - 0.07 * k, 105 - 14 * k, 0)
    frame = world.placed(body.x, body.z, turn=np.arctan2(character.z - body.z, character.x - body.x))
    beast(canvas, frame, anger, arena.clock * TICK)


def _arrow_to_beast(canvas: pygame.Surface, world: Frame, arena: np.record) -> None:
    """Paint an arrow at the edge of the picture if the beast is outside it."""
    if max(abs(arena.beast.x), abs(arena.beast.z)) <= VIEW_RADIUS + 0.5:
        return
    frame = world.placed(0.0, 0.0, turn=np.arctan2(arena.beast.z, arena.beast.x)).placed(VIEW_RADIUS - 0.4, 0.0)
    shape(canvas, frame, ((0.3, 0.0), (-0.3, 0.35), (-0.12, 0.0), (-0.3, -0.35)), BLOOD, WHITE)


def _panel(canvas: pygame.Surface, arena: np.record) -> None:
    """Paint the panel beside the pitch: time alive, clock, blink, speed of the beast, and who is slowed."""
    width, unit = canvas.get_width(), canvas.get_height() / 100
    edge = round(width * SHARE)
    canvas.fill(PANEL, (edge, 0, width - edge, canvas.get_height()))
    canvas.fill(PANEL_EDGE, (edge, 0, FINE, canvas.get_height()))
    left, seconds = edge + 2.5 * unit, arena.tick * TICK
    write(canvas, "BEASTLY", 6.6 * unit, BLOOD, left, 6 * unit)
    write(canvas, "RIVALS", 6.6 * unit, WHITE, left, 11 * unit)
    write(canvas, "alive", 3.4 * unit, DIM, left, 20 * unit)
    write(canvas, f"{int(seconds // 60)}:{seconds % 60:04.1f}", 10 * unit, WHITE, left, 26 * unit)
    remaining = (CLOCK_TICKS - arena.clock) * TICK
    write(canvas, f"clock {remaining:.0f} s", 3.4 * unit, DIM, left, 34 * unit)
    bar(canvas, left, 36.5 * unit, unit, 1.0 - arena.clock / CLOCK_TICKS, PALE)
    ready = arena.cooldown == 0
    write(canvas, "blink", 3.4 * unit, DIM, left, 46 * unit)
    text = "ready" if ready else f"{arena.cooldown * TICK:.1f} s"
    write(canvas, text, 6.6 * unit, BLINK if ready else PALE, left, 50.5 * unit)
    bar(canvas, left, 54.5 * unit, unit, 1.0 - arena.cooldown / COOLDOWN_TICKS, BLINK)
    anger = min(arena.speed / SPEED_LIMIT, 1.0)
    write(canvas, "beast", 3.4 * unit, DIM, left, 64 * unit)
    write(canvas, f"{arena.speed:.1f}", 6.6 * unit, mix(PALE, BLOOD, anger), left, 68.5 * unit)
    bar(canvas, left, 72.5 * unit, unit, anger, BLOOD)
    mark = left + BAR * unit * CHARACTER_SPEED / SPEED_LIMIT
    canvas.fill(WHITE, (mark, 71.6 * unit, FINE, 3.6 * unit))
    write(canvas, "you", 3.0 * unit, PALE, mark, 77 * unit, align=0.5)
    for y, slowed, text in ((88, arena.character_slow, "you are slowed"), (93, arena.beast_slow, "beast is slowed")):
        pygame.draw.circle(canvas, SLOW if slowed else GROOVE, (left + unit, y * unit), unit)
        write(canvas, text, 3.4 * unit, WHITE if slowed else FAINT, left + 3.2 * unit, y * unit)
