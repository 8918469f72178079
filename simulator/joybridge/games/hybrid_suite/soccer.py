"""The rules of Robot Soccer Goal (Masson, Ranchod and Konidaris 2016): a kick, a keeper, and one tick of many arenas.

They are those of the program gym-goal, with its quirks, each of which is a switch in `Rules`. The half field is 20
long, x in 0..20 and y in ±15; the goal is at x = 20.
"""

import math
from typing import NamedTuple

import numpy as np

from joybridge.contract.tensors import Array
from joybridge.games.hybrid_suite.suite_game import COMMON, GOING, TERMINATED
from joybridge.simulator.compiled import compiled
from joybridge.simulator.randomness import BLOCK, Streams, uniform
from joybridge.simulator.trigonometry import arctangent, cosine, sine

KICK, LEFT, RIGHT = range(3)  # actions; the two shots do the same

LENGTH, HALF_WIDTH = 20.0, 15.0  # of the half field
GOAL_HALF, GOAL_DEPTH = 7.01, 2.44
BAR_HALF = GOAL_HALF + 2.0  # how far beside its middle the keeper expects a ball to hit the goal
SHOT_X = 20.4  # of what shots aim at
KICKABLE, CATCHABLE, CATCH_CHANCE = 1.6, 2.0, 1.0  # distances between centers
KEEPER_X = 14.5
AREA_HALF = 9.16  # of the keeper's area
SLOW = 0.1  # speed at which a kicked ball may be kicked again
DECISIONS = 100  # the last one does nothing
MAX_TICK_DRAWS = 7
MAX_TICKS = 5_000  # of a decision; about 300 is the most that random play takes

PLAYER_RADIUS, BALL_RADIUS = 0.9, 0.4
BALL_DECAY = 0.94
WALK_POWER, KEEPER_POWER, DIVE_POWER, MAX_POWER = 10.0, 8.0, 20.0, 100.0


class Kind(NamedTuple):
    """What a player or a ball can do."""

    rate: float  # acceleration per power
    rand: float  # noise, as a share of direction and of speed
    top: float  # largest acceleration and speed along each axis
    decay: float  # factor on the speed, per tick


PLAYER = Kind(0.006, 0.1, 1.0, 0.4)
BALL = Kind(0.027, 0.05, 2.7, BALL_DECAY)


class Rules(NamedTuple):
    """The quirks of the original."""

    kick_along_diagonal: bool  # a kick to (x, y) goes to (x, x)
    low_misses_cost_more: bool  # a miss on the side of negative y is counted 14.02 farther away than it is


ORIGINAL = Rules(True, True)
CORRECTED = Rules(False, False)

BODY = np.dtype([("x", "f8"), ("y", "f8"), ("vx", "f8"), ("vy", "f8"), ("angle", "f8")])
ARENA = np.dtype(
    [
        *COMMON,
        ("player", BODY),
        ("keeper", BODY),
        ("ball", BODY),
        ("ticks", "i8"),
        ("busy", "?"),  # of this decision
        ("noise", "f8"),  # a parameter
    ]
)


@compiled
def begin_episodes(arenas: Array, streams: Streams, which: Array) -> None:
    """Put players, keepers and balls in place, in the arenas of `which` [arenas]: all at rest."""
    for i in range(len(arenas)):
        if which[i]:
            place(arenas[i], uniform(streams, i, -HALF_WIDTH, HALF_WIDTH))


@compiled
def place(arena, y):
    """Put the player at (0, y), the ball as far ahead of it as it can kick, and the keeper before the goal."""
    player, keeper, ball = arena.player, arena.keeper, arena.ball
    for body in (player, keeper, ball):
        body.vx = body.vy = body.angle = 0.0
    player.x, player.y, player.angle = 0.0, y, arctangent(-y, LENGTH)
    reach = KICKABLE - 1e-12
    ball.x, ball.y = reach * cosine(player.angle), y + reach * sine(player.angle)
    slope = -ball.y / (LENGTH - ball.x)
    keeper.x = KEEPER_X
    keeper.y = _limited(slope * keeper.x + (ball.y - slope * ball.x), -AREA_HALF, AREA_HALF)
    keeper.angle = _direction(keeper, ball)
    arena.busy = False


@compiled
def advance(
    arenas: Array, streams: Streams, rules: Rules, action: Array, target_x: Array, target_y: Array, rewards: Array
) -> bool:
    """Advance decisions to their ends, or until random numbers are short; return whether any goes on.

    action [arenas]: KICK, LEFT or RIGHT. target_x, target_y [arenas]: what it aims at; a shot needs y alone.
    """
    going = False
    for i in range(len(arenas)):
        arena = arenas[i]
        if arena.busy and arena.ticks == 0:
            arena.decisions += 1
            if arena.decisions == DECISIONS:
                rewards[i], arena.outcome, arena.busy = -_miss(arena.ball, rules), TERMINATED, False
        x, y = (target_x[i], target_y[i]) if action[i] == KICK else (SHOT_X, target_y[i])
        if action[i] == KICK and rules.kick_along_diagonal:
            y = x
        while arena.busy and streams.cursor[i] <= BLOCK - MAX_TICK_DRAWS:
            rewards[i] = _tick(arena, streams, i, rules, x, y)
            arena.ticks += 1
            over = action[i] == KICK and _apart(arena.player, arena.ball) <= KICKABLE and _speed(arena.ball) <= SLOW
            arena.busy = arena.outcome == GOING and not over and arena.ticks < MAX_TICKS
        going |= arena.busy
    return going


@compiled
def _tick(arena, streams, i, rules, target_x, target_y):
    """Advance an arena by a tick; return the reward."""
    player, keeper, ball, noise = arena.player, arena.keeper, arena.ball, arena.noise
    _play(player, ball, streams, i, noise, target_x, target_y)
    _keep(keeper, ball, streams, i, noise)
    for body in (player, keeper, ball):
        body.x += body.vx
        body.y += body.vy
    for body in (player, keeper):
        _slow_down(body, PLAYER.decay)
    _slow_down(ball, BALL.decay)
    _collide(player, keeper, 2.0 * PLAYER_RADIUS)
    _collide(player, ball, PLAYER_RADIUS + BALL_RADIUS)
    _collide(keeper, ball, PLAYER_RADIUS + BALL_RADIUS)
    if LENGTH <= ball.x <= LENGTH + GOAL_DEPTH and abs(ball.y) <= GOAL_HALF:
        arena.outcome, arena.success = TERMINATED, True
        return 50.0
    caught = uniform(streams, i, 0.0, 1.0) < CATCH_CHANCE and _apart(keeper, ball) < CATCHABLE
    if caught or not (0.0 <= ball.x <= LENGTH and abs(ball.y) <= HALF_WIDTH):
        arena.outcome = TERMINATED
        return -_miss(ball, rules)
    return 0.0


@compiled
def _play(player, ball, streams, i, noise, target_x, target_y):
    """Kick the ball towards a target if it is near enough; else turn or walk to it."""
    bearing, distance = _direction(player, ball), _apart(player, ball)
    if distance > KICKABLE:
        if abs(_wrapped(player.angle - bearing)) >= math.pi / 8:
            player.angle += _wrapped(bearing - player.angle) / (1.0 + 5.0 * _speed(player))
        else:
            _accelerate(player, PLAYER, WALK_POWER, player.angle, streams, i, noise)
        return
    ax = (1.0 - BALL_DECAY) * (target_x - player.x) - ball.vx
    ay = (1.0 - BALL_DECAY) * (target_y - player.y) - ball.vy
    skill = 1.0 - 0.25 * abs(_wrapped(bearing - player.angle)) / math.pi - 0.25 * distance / KICKABLE
    power = _limited(math.sqrt(ax * ax + ay * ay) / (skill * BALL.rate), -MAX_POWER, MAX_POWER) * skill
    _accelerate(ball, BALL, power, arctangent(ay, ax), streams, i, noise)


@compiled
def _keep(keeper, ball, streams, i, noise):
    """Send the keeper to where it meets a ball that will hit the goal, else after the ball."""
    x, y = ball.x + ball.vx / (1.0 - BALL_DECAY), ball.y + ball.vy / (1.0 - BALL_DECAY)  # where the ball comes to rest
    slope = (y - ball.y) / (x - ball.x) if x != ball.x else 0.0
    offset = ball.y - slope * ball.x
    power = KEEPER_POWER
    if x > LENGTH and abs(slope * LENGTH + offset) <= BAR_HALF and slope != 0.0:
        across = -1.0 / slope
        x = (keeper.y - across * keeper.x - offset) / (slope - across)
        y = slope * x + offset
        power = DIVE_POWER
    angle = arctangent(y - keeper.y, x - keeper.x)
    _accelerate(keeper, PLAYER, power, angle, streams, i, noise)
    keeper.angle = angle


@compiled
def _accelerate(body, kind, power, angle, streams, i, noise):
    """Push a body. Noise is a share of the angle, so there is none at angle 0, and a share of the speed."""
    angle *= 1.0 + noise * uniform(streams, i, -kind.rand, kind.rand)
    most, push = kind.rand * _speed(body), power * kind.rate
    ax = push * cosine(angle) + noise * uniform(streams, i, -most, most)
    ay = push * sine(angle) + noise * uniform(streams, i, -most, most)
    body.vx = _limited(body.vx + _limited(ax, -kind.top, kind.top), -kind.top, kind.top)
    body.vy = _limited(body.vy + _limited(ay, -kind.top, kind.top), -kind.top, kind.top)


@compiled
def _collide(one, other, reach):
    """Move two bodies that overlap apart and turn their velocities around."""
    distance = _apart(one, other)
    if distance >= reach:
        return
    shift, angle, back = (reach - distance) / 2.0, _direction(one, other), _direction(other, one)
    one.x += shift * cosine(back)
    one.y += shift * sine(back)
    other.x += shift * cosine(angle)
    other.y += shift * sine(angle)
    for body in (one, other):
        body.vx, body.vy = -body.vx, -body.vy


@compiled
def _miss(ball, rules):
    """Return the distance of the ball to the goal."""
    beside = abs(ball.y) - GOAL_HALF
    if ball.x < LENGTH:
        return LENGTH - ball.x if beside <= 0.0 else math.sqrt((LENGTH - ball.x) ** 2 + beside * beside)
    if ball.y < 0.0 and beside > 0.0 and rules.low_misses_cost_more:
        return GOAL_HALF - ball.y
    return max(beside, 0.0)


@compiled
def _slow_down(body, decay):
    body.vx *= decay
    body.vy *= decay


@compiled
def _apart(one, other):
    """Return the distance between the centers of two bodies."""
    return math.sqrt((one.x - other.x) ** 2 + (one.y - other.y) ** 2)


@compiled
def _direction(one, other):
    """Return the angle at which one body sees another."""
    return arctangent(other.y - one.y, other.x - one.x)


@compiled
def _speed(body):
    return math.sqrt(body.vx * body.vx + body.vy * body.vy)


@compiled
def _wrapped(angle):
    """Return an angle in ±pi."""
    while angle > math.pi:
        angle -= 2.0 * math.pi
    while angle < -math.pi:
        angle += 2.0 * math.pi
    return angle


@compiled
def _limited(value, low, high):
    return min(max(value, low), high)
