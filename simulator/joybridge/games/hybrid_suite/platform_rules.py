"""The rules of Platform: one tick, and one decision, of every arena."""

import numpy as np

from joybridge.contract.tensors import Array
from joybridge.games.hybrid_suite.suite_game import COMMON, GOING, TERMINATED, TRUNCATED
from joybridge.simulator.compiled import compiled
from joybridge.simulator.randomness import BLOCK, NORMAL_DRAWS, Streams, normal

TICK = 0.05  # s
RUN_TICKS = 20  # of a run; a jump lasts until the player stands again
DECISIONS = 200  # per episode, at most
MAX_TICK_DRAWS = 4 * NORMAL_DRAWS

LEFT = np.array([0.0, 475.0, 985.0])  # of the platforms, px
WIDTHS = np.array([250.0, 275.0, 50.0])
GAPS = np.array([225.0, 235.0, 0.0])  # to the right of each
TOP, END = 40.0, 1035.0  # height of the platforms; the goal's x
PLAYER_WIDTH, PLAYER_HEIGHT = 20.0, 30.0  # px; enemies are as large

RUN, HOP, LEAP = range(3)
JUMP_HEIGHT = np.array([0.0, 35.0, 25.0])  # of hop and leap: their speed upwards, px/s
GRAVITY = 9.8
MAX_PUSH_X, MAX_PUSH_Y, MAX_SPEED_X, MAX_SPEED_Y, MAX_RUN_SPEED = 600.0, 4000.0, 100.0, 200.0, 70.0
MAX_JUMP = 200.0  # what the speeds of a jump add up to, at most
DRAG = 0.99  # factor on the speed along x, per tick
ENEMY_START, ENEMY_SPEED = (230.0, 730.0), 30.0
SPEED_NOISE = 0.025  # deviation, per tick

ARENA = np.dtype(
    [
        *COMMON,
        ("x", "f8"),
        ("y", "f8"),
        ("vx", "f8"),
        ("vy", "f8"),  # the player's lower left corner, px, and its velocity
        ("enemy_x", "f8", (2,)),
        ("enemy_v", "f8", (2,)),
        ("start", "f8"),
        ("ticks", "i8"),
        ("busy", "?"),  # of this decision
        ("noise", "f8"),  # a parameter
    ]
)


@compiled
def advance(arenas: Array, streams: Streams, move: Array, strength: Array, rewards: Array) -> bool:
    """Advance decisions to their ends, or until random numbers are short; return whether any goes on.

    move [arenas]: RUN, HOP or LEAP; strength [arenas], px/s or px. rewards [arenas]: that of the last tick counts.
    """
    going = False
    for i in range(len(arenas)):
        arena = arenas[i]
        while arena.busy and streams.cursor[i] <= BLOCK - MAX_TICK_DRAWS:
            _tick(arena, streams, i, move[i], strength[i])
            rewards[i] = (arena.x - arena.start) / END
            landed = arena.ticks == RUN_TICKS if move[i] == RUN else _standing(arena)
            arena.busy = arena.outcome == GOING and not landed
            if not arena.busy:
                arena.decisions += 1
                if arena.outcome == GOING and arena.decisions == DECISIONS:
                    arena.outcome = TRUNCATED
        going |= arena.busy
    return going


@compiled
def _standing(arena):
    """Return whether the player is on a platform."""
    for number in range(len(LEFT)):
        if arena.y == TOP and -PLAYER_WIDTH <= arena.x - LEFT[number] <= WIDTHS[number]:
            return True
    return False


@compiled
def _limited(value, low, high):
    return min(max(value, low), high)


@compiled
def _tick(arena, streams, i, move, strength):
    """Advance the player and one enemy by a tick."""
    standing = _standing(arena)
    if not standing:
        _push(arena, streams, i, 0.0, -GRAVITY)
    elif move == RUN:
        _push(arena, streams, i, strength / TICK, 0.0)
    else:
        up = JUMP_HEIGHT[move]
        ahead = _limited(strength / (2.0 * up / GRAVITY + 1.0) - arena.vx, -MAX_PUSH_X, MAX_JUMP - up)
        ahead -= abs(arena.noise * normal(streams, i))
        up -= abs(arena.noise * normal(streams, i))
        _push(arena, streams, i, ahead / TICK, up / TICK)
    if standing:
        arena.vx = _limited(arena.vx, 0.0, MAX_RUN_SPEED)
    near = 1 if arena.x > LEFT[1] else 0  # the other enemy stands still
    arena.x = _limited(arena.x + arena.vx * TICK, 0.0, END)
    arena.y += arena.vy * TICK
    arena.vx *= DRAG
    _walk(arena, streams, i, near)
    for number in range(len(LEFT)):
        left, width = LEFT[number], WIDTHS[number]
        if left - PLAYER_WIDTH < arena.x < left + width and -PLAYER_HEIGHT < arena.y < TOP:
            _leave_platform(arena, left, width)
    arena.ticks += 1
    arena.success = arena.x >= END
    if arena.success or arena.y < TOP or _caught(arena, 0) or _caught(arena, 1):
        arena.outcome = TERMINATED


@compiled
def _push(arena, streams, i, ahead, up):
    """Accelerate the player, px/s²; it always loses a little speed."""
    arena.vx += _limited(ahead, -MAX_PUSH_X, MAX_PUSH_X) * TICK
    arena.vy += _limited(up, -MAX_PUSH_Y, MAX_PUSH_Y) * TICK
    arena.vx -= abs(arena.noise * (SPEED_NOISE * normal(streams, i)))
    arena.vx = _limited(arena.vx, 0.0, MAX_SPEED_X)
    arena.vy = _limited(arena.vy, -MAX_SPEED_Y, MAX_SPEED_Y)


@compiled
def _walk(arena, streams, i, enemy):
    """Move an enemy, which turns around at the ends of its platform."""
    left, right = LEFT[enemy], LEFT[enemy] + WIDTHS[enemy] - PLAYER_WIDTH
    x, v = arena.enemy_x[enemy], arena.enemy_v[enemy]
    if not left < x < right:
        v = -v
    v = _limited(v + arena.noise * (SPEED_NOISE * normal(streams, i)), -ENEMY_SPEED, ENEMY_SPEED)
    arena.enemy_v[enemy] = v
    arena.enemy_x[enemy] = _limited(x + v * TICK, left, right)


@compiled
def _leave_platform(arena, left, width):
    """Push the player out of a platform, along the axis of the smaller shift, and stop it: each landing does."""
    right = left + width - PLAYER_WIDTH
    x = left - PLAYER_WIDTH if arena.x < left else left + width if arena.x > right else arena.x
    y = -PLAYER_HEIGHT if arena.y < 0.0 else TOP if arena.y > 10.0 else arena.y
    if x == arena.x or (y != arena.y and abs(arena.x - x) >= abs(arena.y - y)):
        arena.y, arena.vy = y, 0.0
    else:
        arena.x = x
    arena.vx = 0.0


@compiled
def _caught(arena, enemy):
    """Return whether the player touches an enemy."""
    beside = abs(arena.x - arena.enemy_x[enemy])
    return beside < PLAYER_WIDTH and abs(arena.y - TOP) < PLAYER_HEIGHT
