"""Pictures of the complete Beastly Rivals Onslaught: the pitch from above, x to the right and z up, and a panel.

The ring around a player is its body: the beast kills the carrier when its muzzle enters the ring, and a click within
the ring is one on the player. What is high above the ground is drawn farther up, over its shadow.
"""

from functools import lru_cache

import numpy as np
import pygame

from joybridge.contract.tensors import Array
from joybridge.games.beastly_rivals_full.beast import BODY_BEHIND, BOX_AHEAD, BOX_HALF
from joybridge.games.beastly_rivals_full.beast import SPEED_LIMIT as BEAST_SPEED
from joybridge.games.beastly_rivals_full.geometry import CORNERS, SEATS
from joybridge.games.beastly_rivals_full.panel import panel
from joybridge.games.beastly_rivals_full.players import BLINK_TICKS
from joybridge.games.beastly_rivals_full.state import (
    BLINK_COOLDOWN,
    MAX_CHARGE,
    PLAYER_RADIUS,
    TICK,
    WIND_UP,
    Rules,
)
from joybridge.games.figures import Clothes, beast, cursor, person
from joybridge.games.painting import (
    AMBER,
    BANK,
    BANK_DARK,
    BLADE,
    BLADE_LIGHT,
    BLINK,
    BLOOD,
    CHALK,
    DIM,
    FAINT,
    GRASS_DARK,
    GRASS_LIGHT,
    INK,
    LEAVES,
    LEAVES_LIGHT,
    NIGHT,
    WHITE,
    WOOD,
    WOOD_SHADE,
    arc,
    disc,
    haze,
    line,
    mix,
    ring,
)
from joybridge.simulator.render import FINE, Color, Frame, fit, picture, shape

HALF_X, HALF_Z = 49.5, 40.5  # units shown to each side of the pitch's center
SHARE = 0.78  # of the picture's width that shows the pitch; the rest is the panel
PERSON, BEAST, CURSOR = 5.4, 4.6, 3.2  # sizes of figures, in units of their own
MUZZLE = 0.46  # how far in front of its origin the beast's figure ends, in units of its own
RISE = 0.35  # how far up a picture shows a unit of height
DARK = 0.55  # share of INK in the dark side of a tunic

PLAYERS: tuple[Color, ...] = (
    (60, 126, 245),
    (240, 84, 68),
    (250, 196, 60),
    (178, 102, 236),
    (252, 138, 46),
    (64, 208, 196),
    (242, 120, 190),
    (196, 214, 226),
)
STONE, STONE_DARK, GHOST = (132, 140, 146), (84, 92, 98), (150, 170, 160)
OUTLINE = np.concatenate([CORNERS, CORNERS[::-1] * (1, -1), -CORNERS, CORNERS[::-1] * (-1, 1)])
TOMBSTONE = ((-1.1, -1.3), (1.1, -1.3), (1.1, 0.7), (0.6, 1.4), (-0.6, 1.4), (-1.1, 0.7))


def draw(arena: np.record, rules: Rules, width: int, height: int) -> Array:
    """Return a picture, uint8 [height, width, 3], of one arena, a record of dtype ARENA."""
    canvas = pygame.Surface((width * FINE, height * FINE), depth=32)
    canvas.blit(_scenery(*canvas.get_size()), (0, 0))
    world = _world(*canvas.get_size())
    players = [arena.players[j] for j in range(rules.players)]
    for player, color in zip(players, PLAYERS, strict=False):
        _plans(canvas, world, arena, player, color)
    for j in sorted(range(rules.players), key=lambda j: -players[j]["z"]):
        _player(canvas, world, arena, j)
    _beast(canvas, world, arena)
    _ball(canvas, world, arena)
    for player, color in zip(players, PLAYERS, strict=False):
        pointer = player["pointer_x"], player["pointer_z"]
        if player["alive"] and pointer != tuple(SEATS[player["seat"]]):  # where scripts and the first picture leave it
            cursor(canvas, world.placed(*pointer, CURSOR, CURSOR), color)
    panel(canvas, round(canvas.get_width() * SHARE), arena, rules, PLAYERS)
    return picture(canvas)


def _world(width: int, height: int) -> Frame:
    return fit(round(width * SHARE), height, HALF_X, HALF_Z)


@lru_cache(maxsize=8)
def _scenery(width: int, height: int) -> pygame.Surface:
    """Return the background: a forest at night, and in it the pitch with the seats."""
    canvas = pygame.Surface((width, height), depth=32)
    canvas.fill(WOOD)
    world, random = _world(width, height), np.random.default_rng(7)
    for x, z, size, tone in random.uniform((-56.0, -46.0, 1.2, 0.0), (56.0, 46.0, 3.2, 1.0), (700, 4)):
        tree = world.placed(x, z, size, size)
        disc(canvas, tree, WOOD_SHADE, 1.08, 0.2, -0.25)
        disc(canvas, tree, mix(WOOD, LEAVES, tone), 1.0)
        disc(canvas, tree, mix(LEAVES, LEAVES_LIGHT, tone), 0.5, -0.25, 0.3)
    for rim, color in ((2.6, BANK_DARK), (1.9, BANK)):
        shape(canvas, world, OUTLINE * (1.0 + rim / 46.0), color)
    for band in range(8):
        shape(canvas, world, OUTLINE * (8 - band) / 8, GRASS_LIGHT if band % 2 else GRASS_DARK)
    for x, z, tall, tone in random.uniform((-46.0, -37.0, 0.4, 0.0), (46.0, 37.0, 1.1, 1.0), (1500, 4)):
        if abs(x) / 46.0 + abs(z) / 37.0 < 1.35:
            line(canvas, world.placed(x, z), mix(BLADE, BLADE_LIGHT, tone), [(0.0, 0.0), (0.25, tall)], 0.25)
    line(canvas, world, CHALK, [*OUTLINE, OUTLINE[0]], 0.45)
    ring(canvas, world, mix(GRASS_LIGHT, CHALK, 0.45), 6.0, 0.3)
    disc(canvas, world, mix(GRASS_LIGHT, CHALK, 0.6), 0.6)
    for x, z in SEATS:
        ring(canvas, world.placed(x, z), mix(GRASS_LIGHT, CHALK, 0.3), 2.6, 0.25)
    haze(canvas, world, NIGHT, 64.0, 0, 170, clear=0.5)
    return canvas


def _plans(canvas: pygame.Surface, world: Frame, arena: np.record, player: np.record, color: Color) -> None:
    """Paint where a player goes, where its blink lands, and to whom it passes."""
    place, tint = world.placed(player["x"], player["z"]), mix(GRASS_LIGHT, color, 0.7)
    if not player["alive"]:
        return
    if player["walking"]:
        way = np.array([player["path_x"] - player["x"], player["path_z"] - player["z"]])
        far = float(np.hypot(*way))
        for distance in np.arange(3.0, far - 0.5, 1.8):
            disc(canvas, place, tint, 0.28, *(way * distance / far))
        if far > 0.5:
            cross = world.placed(player["path_x"], player["path_z"])
            line(canvas, cross, tint, [(-0.8, -0.8), (0.8, 0.8)], 0.4)
            line(canvas, cross, tint, [(-0.8, 0.8), (0.8, -0.8)], 0.4)
    if player["blink_tick"] > arena.tick:
        share = (player["blink_tick"] - arena.tick) / BLINK_TICKS
        for frame in (place, world.placed(player["blink_x"], player["blink_z"])):
            haze(canvas, frame, BLINK, 3.6, 150, 0, clear=0.2)
            ring(canvas, frame, BLINK, PLAYER_RADIUS * (0.6 + share), 0.3)
    if player["throw_tick"] > 0:
        rival = arena.players[player["throw_to"]]
        share = 1.0 - (player["throw_tick"] - arena.tick) / WIND_UP
        arrow = np.array([(player["x"], player["z"]), (rival["x"], rival["z"])])
        line(canvas, world, mix(GRASS_LIGHT, WHITE, 0.35), arrow, 0.3)
        line(canvas, world, WHITE, [arrow[0], arrow[0] + share * (arrow[1] - arrow[0])], 0.5)


def _player(canvas: pygame.Surface, world: Frame, arena: np.record, j: int) -> None:
    """Paint a player; a ghost if it waits for its revival, a tombstone if it is out.

    The arc around the ring fills during the cooldown of blink and glows when blink is ready.
    """
    player, color = arena.players[j], PLAYERS[j]
    place = world.placed(player["x"], player["z"])
    haze(canvas, place.placed(0.5, -0.6), INK, 2.9, 150, 0, clear=0.3)
    if player["out"]:
        shape(canvas, place, TOMBSTONE, STONE, INK)
        line(canvas, place, mix(STONE_DARK, color, 0.6), [(0.0, -0.8), (0.0, 0.9)], 0.45)
        line(canvas, place, mix(STONE_DARK, color, 0.6), [(-0.6, 0.35), (0.6, 0.35)], 0.45)
        return
    turn = np.arctan2(player["fz"], player["fx"])
    frame = world.placed(player["x"], player["z"], PERSON, PERSON, turn)
    if not player["alive"]:
        person(canvas, frame, Clothes(mix(GHOST, color, 0.25), DIM, FAINT), 0.3)
        ring(canvas, place, mix(GRASS_DARK, color, 0.35), PLAYER_RADIUS, 0.3)
        return
    cooldown = max(int(player["blink_ready"] - arena.tick), 0)
    if arena.target == j:
        haze(canvas, place, BLOOD, 5.2, 190, 0, clear=0.2)
    ring(canvas, place, INK, PLAYER_RADIUS + 0.25, 0.9)
    ring(canvas, place, color, PLAYER_RADIUS, 0.45)
    if cooldown:
        arc(canvas, place, mix(BLINK, DIM, 0.35), 2.75, np.pi / 2, -2 * np.pi * (1.0 - cooldown / BLINK_COOLDOWN))
    else:
        ring(canvas, place, mix(GRASS_DARK, BLINK, 0.75), 2.9, 0.3)
    speed = float(np.hypot(player["vx"], player["vz"]))
    stride = 0.14 * np.sin(18.0 * arena.tick * TICK) if speed > 0.5 else 0.0
    person(canvas, frame, Clothes(color, mix(color, INK, DARK)), stride)


def _beast(canvas: pygame.Surface, world: Frame, arena: np.record) -> None:
    """Paint the beast so that its muzzle ends where its box does, in a color that shows its speed."""
    state = arena.beast
    ahead = BOX_AHEAD + BOX_HALF - MUZZLE * BEAST
    x = state["x"] - BODY_BEHIND * state["fx"] + ahead * state["gx"]
    z = state["z"] - BODY_BEHIND * state["fz"] + ahead * state["gz"]
    anger = float(np.clip(state["speed"] / (0.5 * BEAST_SPEED), 0.0, 1.0))
    for k in range(6, 0, -1) if arena.target >= 0 else ():  # a trail of dust, then of embers
        puff = world.placed(x - 0.05 * k * state["speed"] * state["fx"], z - 0.05 * k * state["speed"] * state["fz"])
        haze(canvas, puff, mix(WOOD_SHADE, BLOOD, round(anger, 1)), 3.4 - 0.3 * k, 105 - 14 * k, 0)
    frame = world.placed(x, z, BEAST, BEAST, np.arctan2(state["gz"], state["gx"]))
    beast(canvas, frame, anger if arena.target >= 0 else 0.0, arena.tick * TICK)


def _ball(canvas: pygame.Surface, world: Frame, arena: np.record) -> None:
    """Paint the ball: above its carrier's head, glowing with its charge, or in the air with its shadow."""
    state, height = arena.ball, 4.0
    if arena.carrier >= 0:
        x, z = arena.players[arena.carrier]["x"], arena.players[arena.carrier]["z"]
    elif state["flying"]:
        x, z, height = state["x"], state["z"], float(state["y"])
        haze(canvas, world.placed(x, z), INK, 1.6, 190, 0, clear=0.3)
    else:
        return
    frame = world.placed(x, z + RISE * height)
    charge = float(min(arena.charge / MAX_CHARGE, 1.0))
    if charge > 0.0:
        haze(canvas, frame, mix(AMBER, BLOOD, round(charge, 1)), round(2.0 + 3.0 * charge, 1), 220, 0, clear=0.1)
    size = 1.0 + 0.02 * height
    disc(canvas, frame, INK, size + 0.25)
    disc(canvas, frame, mix(WHITE, AMBER, charge), size)
    disc(canvas, frame, mix(AMBER, BLOOD, charge), 0.45 * size)
