"""Pictures of Beastly Rivals Onslaught: the pitch from above, x to the right and z up, and a panel.

The beast's muzzle ends where its collider does: the beast kills exactly when the muzzle touches the character.
"""

from functools import lru_cache

import numpy as np
import pygame

from joybridge.contract.tensors import Array
from joybridge.games.beastly_rivals.rules import (
    BOUNDARY_RADIUS,
    CHARACTER_RADIUS,
    CHARACTER_SPEED,
    CLOCK_TICKS,
    COOLDOWN_TICKS,
    PITCH_RADIUS,
    SPEED_LIMIT,
    SPHERE_RADIUS,
    TICK,
)  # fmt: skip
from joybridge.simulator.render import FINE, Color, Frame, ellipse, fit, picture, shape, write

VIEW_RADIUS = 8.3  # units shown to each side of the pitch's center
SHARE = 0.75  # of the picture's width that shows the pitch; the rest is the panel

WOOD, WOOD_SHADE, LEAVES, LEAVES_LIGHT = (15, 30, 28), (6, 14, 14), (24, 48, 40), (44, 78, 56)
BANK, BANK_DARK, NIGHT = (48, 88, 48), (10, 22, 18), (4, 10, 12)
GRASS_DARK, GRASS_LIGHT, BLADE, BLADE_LIGHT = (74, 128, 62), (84, 141, 69), (58, 106, 52), (118, 172, 86)
INK, WHITE, CHALK, AMBER = (18, 20, 26), (248, 248, 242), (214, 230, 196), (250, 190, 70)
BLINK, SLOW, BLOOD = (92, 225, 240), (146, 124, 250), (232, 60, 50)
TUNIC, TUNIC_DARK, SKIN, HAIR, BOOT = (44, 104, 222), (28, 66, 150), (246, 206, 170), (250, 214, 96), (70, 46, 36)
FUR_CALM, FUR_ANGRY, THROAT, BONE = (70, 54, 92), (186, 24, 30), (44, 4, 8), (240, 230, 206)
EYE_CALM, EYE_ANGRY = (255, 206, 64), (255, 244, 200)
PANEL, PANEL_EDGE, GROOVE = (13, 20, 26), (40, 58, 60), (34, 44, 52)
FAINT, DIM, PALE = (62, 76, 82), (120, 136, 138), (198, 210, 208)

BAR = 28.0  # length of the panel's bars, in hundredths of the picture's height

# The beast faces +x, with its position at (0, 0). Of parts in pairs, the left one.
_SPIKES = np.arange(30) * np.pi / 15
_SPIKE_LENGTHS = np.where(np.arange(30) % 2, 1.0, 0.72)
FUR = np.stack([-0.36 + 0.84 * _SPIKE_LENGTHS * np.cos(_SPIKES), 0.76 * _SPIKE_LENGTHS * np.sin(_SPIKES)], axis=1)
MANE = FUR * 0.64 + (-0.24, 0.0)
HEAD = (
    (0.46, 0.0), (0.42, 0.24), (0.16, 0.42), (-0.26, 0.42), (-0.42, 0.0), (-0.26, -0.42), (0.16, -0.42), (0.42, -0.24),
)  # fmt: skip
MAW = ((0.46, 0.0), (0.42, 0.25), (0.24, 0.31), (0.14, 0.0), (0.24, -0.31), (0.42, -0.25))
HORN = ((-0.06, 0.32), (0.06, 0.62), (0.34, 0.8), (0.68, 0.74), (0.4, 0.62), (0.26, 0.36))
EYE = ((-0.22, 0.07), (0.12, 0.14), (0.0, 0.36))
PAWS = ((0.3, 0.62), (0.3, -0.62), (-0.92, 0.6), (-0.92, -0.6))
CLAWS = (-0.1, 0.0, 0.1)


def draw(arena: np.record, width: int, height: int) -> Array:
    """Return a picture, uint8 [height, width, 3], of one arena, a record of dtype ARENA."""
    canvas = pygame.Surface((width * FINE, height * FINE), depth=32)
    canvas.blit(_scenery(*canvas.get_size()), (0, 0))
    world = _world(*canvas.get_size())
    _sphere(canvas, world, arena)
    _goal(canvas, world, arena)
    _character(canvas, world, arena)
    _beast(canvas, world, arena)
    _arrow_to_beast(canvas, world, arena)
    _cursor(canvas, world.placed(arena.cursor.x, arena.cursor.z))
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
        _disc(canvas, tree, WOOD_SHADE, 1.08, 0.2, -0.25)
        _disc(canvas, tree, _mix(WOOD, LEAVES, tone), 1.0)
        _disc(canvas, tree, _mix(LEAVES, LEAVES_LIGHT, tone), 0.5, -0.25, 0.3)
    _disc(canvas, world, BANK_DARK, PITCH_RADIUS + 0.45)
    _disc(canvas, world, BANK, PITCH_RADIUS + 0.3)
    for ring in range(8):
        _disc(canvas, world, GRASS_LIGHT if ring % 2 else GRASS_DARK, PITCH_RADIUS * (8 - ring) / 8)
    for angle, share, tall, tone in random.uniform((0, 0, 0.06, 0), (2 * np.pi, 1, 0.16, 1), (900, 4)):
        distance = PITCH_RADIUS * np.sqrt(share)
        blade = world.placed(distance * np.cos(angle), distance * np.sin(angle))
        _line(canvas, blade, _mix(BLADE, BLADE_LIGHT, tone), [(0.0, 0.0), (0.04, tall)], 0.04)
    _ring(canvas, world, CHALK, BOUNDARY_RADIUS, 0.07)
    _ring(canvas, world, _mix(GRASS_LIGHT, CHALK, 0.45), 1.1, 0.05)
    _disc(canvas, world, _mix(GRASS_LIGHT, CHALK, 0.6), 0.1)
    _haze(canvas, world, NIGHT, 9.2, 0, 150, clear=0.62)
    return canvas


def _mix(a: Color, b: Color, share: float) -> Color:
    """Return a color between a (share 0) and b (share 1)."""
    red, green, blue = (round(p + (q - p) * share) for p, q in zip(a, b, strict=True))
    return red, green, blue


def _disc(canvas: pygame.Surface, frame: Frame, fill: Color, radius: float, x: float = 0.0, y: float = 0.0) -> None:
    pygame.draw.circle(canvas, fill, frame.points([(x, y)])[0].tolist(), frame.length(radius))


def _ring(canvas: pygame.Surface, frame: Frame, color: Color, radius: float, width: float) -> None:
    pygame.draw.circle(canvas, color, frame.origin.tolist(), frame.length(radius), max(round(frame.length(width)), 2))


def _arc(canvas: pygame.Surface, frame: Frame, color: Color, radius: float, start: float, turn: float) -> None:
    """Draw part of a circle from angle `start` on, `turn` counter-clockwise, both in rad."""
    angles = start + turn * np.linspace(0.0, 1.0, 40)
    _line(canvas, frame, color, radius * np.stack([np.cos(angles), np.sin(angles)], axis=1), 0.08)


def _line(canvas: pygame.Surface, frame: Frame, color: Color, points: object, width: float) -> None:
    pixels = frame.points(points).tolist()  # type: ignore[arg-type]
    pygame.draw.lines(canvas, color, False, pixels, max(round(frame.length(width)), 2))


def _haze(
    canvas: pygame.Surface, frame: Frame, color: Color, radius: float, inner: int, outer: int, clear: float = 0.0
) -> None:
    """Paint a soft disc: opacity (0..255) `inner` up to `clear` times the radius, then changing to `outer`."""
    soft = _soft_disc(round(frame.length(radius)), color, inner, outer, clear)
    canvas.blit(soft, (frame.origin - soft.get_width() / 2).round().tolist())


@lru_cache(maxsize=64)
def _soft_disc(radius: int, color: Color, inner: int, outer: int, clear: float) -> pygame.Surface:
    axis = np.arange(-radius, radius) + 0.5
    distance = np.hypot(axis[:, None], axis) / radius
    share = np.clip((distance - clear) / (1.0 - clear), 0.0, 1.0)
    pixels = np.empty((2 * radius, 2 * radius, 4), np.uint8)
    pixels[:, :, 2::-1] = color  # the order of the canvas, in which it is painted faster
    pixels[:, :, 3] = np.where(distance <= 1.0, inner + (outer - inner) * share * share * (3.0 - 2.0 * share), 0.0)
    return pygame.image.frombuffer(pixels.tobytes(), (2 * radius, 2 * radius), "BGRA")


def _sphere(canvas: pygame.Surface, world: Frame, arena: np.record) -> None:
    """Paint a translucent dome with three slowly turning arcs."""
    frame = world.placed(arena.sphere.x, arena.sphere.z)
    _haze(canvas, frame, SLOW, SPHERE_RADIUS, 60, 165, clear=0.35)
    _haze(canvas, frame.placed(-1.0, 1.15), WHITE, 1.2, 70, 0)
    _ring(canvas, frame, _mix(SLOW, WHITE, 0.5), SPHERE_RADIUS, 0.07)
    for k in range(3):
        _arc(canvas, frame, _mix(SLOW, WHITE, 0.25), 2.3, 0.6 * arena.clock * TICK + k * 2 * np.pi / 3, 1.1)


def _goal(canvas: pygame.Surface, world: Frame, arena: np.record) -> None:
    """Paint a flag at the goal of a walking character, and dots on the way there."""
    if not arena.moving:
        return
    flag, start = world.placed(arena.goal_x, arena.goal_z), world.placed(arena.character.x, arena.character.z)
    way = np.array([arena.goal_x - arena.character.x, arena.goal_z - arena.character.z])
    for distance in np.arange(0.7, np.hypot(*way) - 0.2, 0.35):
        _disc(canvas, start, CHALK, 0.05, *(way * distance / np.hypot(*way)))
    _haze(canvas, flag.placed(0.06, 0.0), INK, 0.2, 120, 0)
    _line(canvas, flag, BOOT, [(0.0, 0.0), (0.0, 0.7)], 0.08)
    shape(canvas, flag, ((0.03, 0.7), (0.5, 0.53), (0.03, 0.34)), AMBER, INK)


def _character(canvas: pygame.Surface, world: Frame, arena: np.record) -> None:
    """Paint the character. The ring around it fills during the cooldown of blink and glows when blink is ready."""
    body, ready = arena.character, arena.cooldown == 0
    still = body.vx == 0.0 and body.vz == 0.0  # then it looks at the beast
    turn = np.arctan2(arena.beast.z - body.z, arena.beast.x - body.x) if still else np.arctan2(body.vz, body.vx)
    place = world.placed(body.x, body.z)
    _haze(canvas, place.placed(0.1, -0.12), INK, 0.55, 150, 0, clear=0.3)
    if ready:
        _haze(canvas, place, BLINK, 0.95, 130, 0, clear=0.3)
    _ring(canvas, place, _mix(GRASS_DARK, INK, 0.5), 0.54, 0.09)
    filled = 2 * np.pi * (1.0 - arena.cooldown / COOLDOWN_TICKS)
    _arc(canvas, place, BLINK if ready else _mix(BLINK, DIM, 0.35), 0.5, np.pi / 2, -filled)
    frame = world.placed(body.x, body.z, turn=turn)
    stride = 0.0 if still else 0.14 * np.sin(25.0 * arena.clock * TICK)
    for side in (1.0, -1.0):
        shape(canvas, frame, ellipse(0.1 + side * stride, side * 0.14, 0.16, 0.1), BOOT, INK)
        shape(canvas, frame, ellipse(0.08 - side * stride, side * 0.31, 0.12, 0.1), SKIN, INK)
    shape(canvas, frame, ellipse(-0.02, 0.0, 0.22, CHARACTER_RADIUS + 0.04), TUNIC, INK)
    shape(canvas, frame, ellipse(-0.12, 0.0, 0.1, 0.2), TUNIC_DARK)
    shape(canvas, frame, ellipse(0.04, 0.0, 0.2, 0.2), SKIN, INK)
    shape(canvas, frame, ellipse(-0.02, 0.0, 0.17, 0.2), HAIR, INK)


def _beast(canvas: pygame.Surface, world: Frame, arena: np.record) -> None:
    """Paint the beast, turned to the character, in a color that shows its speed."""
    beast, character = arena.beast, arena.character
    anger = round(min(arena.speed / SPEED_LIMIT, 1.0), 2)
    fur, step = _mix(FUR_CALM, FUR_ANGRY, anger), 0.14 * np.sin((5.0 + 25.0 * anger) * arena.clock * TICK)
    frame = world.placed(beast.x, beast.z, turn=np.arctan2(character.z - beast.z, character.x - beast.x))
    for k in range(6, 0, -1):  # a trail of dust, then of embers
        puff = world.placed(beast.x - 0.06 * k * beast.vx, beast.z - 0.06 * k * beast.vz)
        _haze(canvas, puff, _mix(BOOT, BLOOD, round(anger, 1)), 0.75 - 0.07 * k, 105 - 14 * k, 0)
    _haze(canvas, frame.placed(-0.36, 0.0), INK, 1.2, 190, 0, clear=0.4)
    _haze(canvas, frame.placed(-0.3, 0.0), BLOOD, 1.7, round(120 * round(anger, 1)), 0, clear=0.3)
    for (x, y), stride in zip(PAWS, (step, -step, -step, step), strict=True):
        paw = frame.placed(x + stride, y)
        shape(canvas, paw, ellipse(0.0, 0.0, 0.2, 0.17), _mix(fur, INK, 0.45), INK)
        for claw in CLAWS:
            shape(canvas, paw, ((0.12, claw - 0.04), (0.34, 1.3 * claw), (0.12, claw + 0.04)), BONE)
    shape(canvas, frame, FUR, fur, _mix(fur, INK, 0.75))
    shape(canvas, frame, MANE, _mix(fur, INK, 0.3))
    for side in (1.0, -1.0):
        shape(canvas, frame, np.multiply(HORN, (1.0, side)), BONE, INK)
    shape(canvas, frame, HEAD, _mix(fur, INK, 0.12), INK)
    shape(canvas, frame, MAW, THROAT)
    for y in (-0.2, -0.1, 0.0, 0.1, 0.2):
        tip = 0.44 - abs(y) * 0.3
        shape(canvas, frame, ((tip, y - 0.05), (tip, y + 0.05), (tip - 0.16, y)), BONE)
    for side in (1.0, -1.0):
        _haze(canvas, frame.placed(-0.04, 0.2 * side), AMBER, 0.34, 170, 0)
        shape(canvas, frame, np.multiply(EYE, (1.0, side)), _mix(EYE_CALM, EYE_ANGRY, anger), INK)
        _disc(canvas, frame, INK, 0.05, 0.02, 0.18 * side)


def _arrow_to_beast(canvas: pygame.Surface, world: Frame, arena: np.record) -> None:
    """Paint an arrow at the edge of the picture if the beast is outside it."""
    if max(abs(arena.beast.x), abs(arena.beast.z)) <= VIEW_RADIUS + 0.5:
        return
    frame = world.placed(0.0, 0.0, turn=np.arctan2(arena.beast.z, arena.beast.x)).placed(VIEW_RADIUS - 0.4, 0.0)
    shape(canvas, frame, ((0.3, 0.0), (-0.3, 0.35), (-0.12, 0.0), (-0.3, -0.35)), BLOOD, WHITE)


def _cursor(canvas: pygame.Surface, frame: Frame) -> None:
    """Paint the cursor. A dark rim makes it visible on any background."""
    for color, rim in ((INK, 0.06), (WHITE, 0.0)):
        _ring(canvas, frame, color, 0.32 + rim, 0.09 + 2 * rim)
        for x, y in ((1, 0), (-1, 0), (0, 1), (0, -1)):
            inner, outer = 0.2 - rim, 0.56 + rim
            _line(canvas, frame, color, [(inner * x, inner * y), (outer * x, outer * y)], 0.09 + 2 * rim)
    _disc(canvas, frame, AMBER, 0.08)


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
    _bar(canvas, left, 36.5 * unit, unit, 1.0 - arena.clock / CLOCK_TICKS, PALE)
    ready = arena.cooldown == 0
    write(canvas, "blink", 3.4 * unit, DIM, left, 46 * unit)
    text = "ready" if ready else f"{arena.cooldown * TICK:.1f} s"
    write(canvas, text, 6.6 * unit, BLINK if ready else PALE, left, 50.5 * unit)
    _bar(canvas, left, 54.5 * unit, unit, 1.0 - arena.cooldown / COOLDOWN_TICKS, BLINK)
    anger = min(arena.speed / SPEED_LIMIT, 1.0)
    write(canvas, "beast", 3.4 * unit, DIM, left, 64 * unit)
    write(canvas, f"{arena.speed:.1f}", 6.6 * unit, _mix(PALE, BLOOD, anger), left, 68.5 * unit)
    _bar(canvas, left, 72.5 * unit, unit, anger, BLOOD)
    mark = left + BAR * unit * CHARACTER_SPEED / SPEED_LIMIT
    canvas.fill(WHITE, (mark, 71.6 * unit, FINE, 3.6 * unit))
    write(canvas, "you", 3.0 * unit, PALE, mark, 77 * unit, align=0.5)
    for y, slowed, text in ((88, arena.character_slow, "you are slowed"), (93, arena.beast_slow, "beast is slowed")):
        pygame.draw.circle(canvas, SLOW if slowed else GROOVE, (left + unit, y * unit), unit)
        write(canvas, text, 3.4 * unit, WHITE if slowed else FAINT, left + 3.2 * unit, y * unit)


def _bar(canvas: pygame.Surface, left: float, top: float, unit: float, share: float, color: Color) -> None:
    """Paint a bar that is filled up to a share (0..1)."""
    pygame.draw.rect(canvas, GROOVE, (left, top, BAR * unit, 1.8 * unit), border_radius=round(unit))
    if share > 0.0:
        filled = max(BAR * share, 1.8) * unit
        pygame.draw.rect(canvas, color, (left, top, filled, 1.8 * unit), border_radius=round(unit))
