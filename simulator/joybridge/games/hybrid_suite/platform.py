"""Platform (Masson, Ranchod and Konidaris 2016): run, hop or leap over two gaps and past two enemies.

The rules are those of the program gym-platform. A decision is a whole run of one second, or a whole jump. Its reward is
the progress, so a return of 1 is the goal.
"""

from collections.abc import Mapping

import numpy as np

from joybridge.games.hybrid_suite.suite_game import (
    CHANNELS,
    COMMON,
    GOING,
    METRICS,
    TERMINATED,
    TRUNCATED,
    SuiteGame,
)
from joybridge.simulator import (
    ActArrays,
    Array,
    axis,
    behavior,
    branch,
    check_range,
    parameter,
    sensor,
    spec,
)
from joybridge.simulator.compiled import compiled
from joybridge.simulator.randomness import BLOCK, NORMAL_DRAWS, Streams, normal, reserve
from joybridge.v1 import bridge_pb2 as pb

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

PICTURE = (640, 240)  # width, height

PARAMETERS = [parameter("noise", 0.0, 1.0, 1.0, "factor on the noise of motions and jumps")]

SENSORS = [
    sensor("player", [2], 0.0, 1.0, "the player", elements=["x", "velocity x"]),
    sensor("enemy", [2], 0.0, 1.0, "the enemy of the player's platform", elements=["x", "velocity x"]),
    sensor(
        "platforms",
        [5],
        0.0,
        1.0,
        "the player's platform and what follows it",
        elements=["width", "next width", "gap", "left", "height difference"],
    ),
]

ARENA = np.dtype(
    [
        *COMMON,
        ("x", "f8"), ("y", "f8"), ("vx", "f8"), ("vy", "f8"),  # the player's lower left corner, px, and its velocity
        ("enemy_x", "f8", (2,)), ("enemy_v", "f8", (2,)),
        ("start", "f8"), ("ticks", "i8"), ("busy", "?"),  # of this decision
        ("noise", "f8"),  # a parameter
    ]
)  # fmt: skip


class Platform(SuiteGame):
    """A player that jumps from platform to platform."""

    name = "platform"
    description = "Run, hop or leap over two gaps: three actions, each with a strength of its own."
    arena_dtype = ARENA
    parameters, sensors = PARAMETERS, SENSORS

    @classmethod
    def describe(cls, options: Mapping[str, str]) -> pb.GameSpec:
        """Return the spec: a branch for the action and an axis for the strength of each."""
        player = behavior(
            "player",
            description="the reward is the share of the way that a decision has covered",
            sensors=SENSORS,
            axes=[
                axis("run", 0.0, 30.0, "push of a run, px/s per tick", only_with=("move", "run")),
                axis("hop", 0.0, 720.0, "length that a hop aims at, px", only_with=("move", "hop")),
                axis("leap", 0.0, 430.0, "length that a leap aims at, px", only_with=("move", "leap")),
            ],
            branches=[branch("move", ["run", "hop", "leap"])],
            channels=CHANNELS,
            metrics=METRICS,
        )
        return spec(
            cls,
            [player],
            parameters=PARAMETERS,
            max_episode_decisions=DECISIONS,
            max_arenas=4096,
            picture=PICTURE,
            snapshot_bytes_per_arena=ARENA.itemsize + 64,
            parameters_per_episode=True,
        )

    def begin_where(self, which: Array) -> None:
        """Put the player at the left end.

        Nothing there is random, but an unused number keeps episodes after a reset from having the noise of the last.
        """
        reserve(self.streams, MAX_TICK_DRAWS)
        self.streams.cursor[which] += 1
        fields = self.fields
        for name, value in (("x", 0.0), ("y", TOP), ("vx", 0.0), ("vy", 0.0), ("busy", False)):
            fields[name][which] = value
        fields["enemy_x"][which], fields["enemy_v"][which] = ENEMY_START, -ENEMY_SPEED

    def decide(self, act: ActArrays, rewards: Array) -> None:
        """Run or jump."""
        move = act.choices[:, 0].copy()
        strength = act.axes[np.arange(len(move)), move].astype(np.float64)
        fields = self.fields
        fields["start"], fields["ticks"], fields["busy"] = fields["x"], 0, True
        reserve(self.streams, MAX_TICK_DRAWS)
        while advance(self.arenas, self.streams, move, strength, rewards):
            reserve(self.streams, MAX_TICK_DRAWS)

    def distance(self) -> Array:
        """Return how far every player is from the goal, px."""
        return END - self.fields["x"]

    def write_sensors(self, *values: Array) -> None:
        """Write the values of every sensor."""
        _observe(self.arenas, *values)

    def draw(self, arena: int) -> Array:
        """Return a picture of one arena, uint8 [height, width, 3]."""
        from joybridge.games.hybrid_suite.drawing import (
            draw_platform,
        )  # imported here because only pictures need pygame

        return draw_platform(self.arenas[arena], *PICTURE)

    def check_arenas(self, arenas: Array) -> None:
        """Raise ValueError for arenas in a state that cannot occur."""
        super().check_arenas(arenas)
        check_range("decisions", arenas["decisions"], 0, DECISIONS - 1)
        check_range("x", arenas["x"], 0.0, END)
        check_range("y", arenas["y"], TOP, 2.0 * MAX_SPEED_Y)
        check_range("vx", arenas["vx"], 0.0, MAX_SPEED_X)
        check_range("vy", arenas["vy"], -MAX_SPEED_Y, MAX_SPEED_Y)
        check_range("enemy_x", arenas["enemy_x"], 0.0, END)
        check_range("enemy_v", arenas["enemy_v"], -ENEMY_SPEED, ENEMY_SPEED)
        check_range("start", arenas["start"], 0.0, END)
        check_range("ticks", arenas["ticks"], 0, 2**31)
        check_range("busy", arenas["busy"].view(np.uint8), 0, 0)


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


@compiled
def _observe(arenas, player, enemy, platforms):
    """Write the sensors of every arena."""
    for i in range(len(arenas)):
        arena = arenas[i]
        near = 1 if arena.x > LEFT[1] else 0
        here = 0 if arena.x < LEFT[1] else 1 if arena.x < LEFT[2] else 2
        player[i, 0], player[i, 1] = (arena.x + PLAYER_WIDTH) / (END + PLAYER_WIDTH), arena.vx / MAX_SPEED_X
        enemy[i, 0] = arena.enemy_x[near] / END
        enemy[i, 1] = (arena.enemy_v[near] + ENEMY_SPEED) / (2.0 * ENEMY_SPEED)
        platforms[i, 0] = WIDTHS[here] / WIDTHS[1]
        platforms[i, 1] = (WIDTHS[here + 1] if here < 2 else 0.0) / WIDTHS[1]
        platforms[i, 2] = GAPS[here] / GAPS[1]
        platforms[i, 3] = LEFT[here] / END
        platforms[i, 4] = 0.0
