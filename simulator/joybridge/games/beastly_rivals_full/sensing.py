"""What each agent observes: itself, its pointer, its rivals, the beast, the ball and the match.

The living rivals come first, and the nearest to the pointer before the others: who is pointed at, or nearly, is always
in the same place, whatever its number. A rival that is out is zeros.
"""

import math

import numpy as np

from joybridge.games.beastly_rivals_full.ball import ABOVE, HANDS, SPEED_LIMIT
from joybridge.games.beastly_rivals_full.beast import SPEED_LIMIT as BEAST_SPEED
from joybridge.games.beastly_rivals_full.beast import TURNING_LIMIT
from joybridge.games.beastly_rivals_full.geometry import length
from joybridge.games.beastly_rivals_full.players import under
from joybridge.games.beastly_rivals_full.rules import POINTER_X, TOP_SPEED
from joybridge.games.beastly_rivals_full.state import (
    BLINK_COOLDOWN,
    BOOST_TICKS,
    CHARGE_FROM,
    DEAD,
    DECISION_TICKS,
    HUNT,
    MAX_DECISIONS,
    MAX_PLAYERS,
    PLAYER_SPEED,
    START,
    TICK,
    WIND_UP,
)
from joybridge.simulator import sensor
from joybridge.simulator.compiled import compiled
from joybridge.v1 import bridge_pb2 as pb

PLACE_UNIT = POINTER_X  # units; of all positions
KILLS_UNIT, CHARGE_UNIT, PHASE_TICKS = 10.0, 15.0, 300.0
BALL_TOP = HANDS + ABOVE
REACH = TOP_SPEED * DECISION_TICKS * TICK  # units; how far a pointer gets in a decision along an axis
NEAR = 2.0  # reaches; farther rivals seem as far from the pointer
MAX_DISTANCE = 10.0  # the beast may leave the pitch, and a boost has no limit: its values are clipped

OWN = [
    "x", "z", "velocity x", "velocity z", "direction x", "direction z", "lives", "kills", "has the ball", "is hunted",
    "turns to pass", "wind-up", "blink cooldown", "blink ready", "goal x", "goal z",
]  # fmt: skip
POINTER = ["x", "z", "velocity x", "velocity z", "on itself", "on a rival"]
RIVAL = [
    "present", "alive", "x", "z", "velocity x", "velocity z", "direction x", "direction z", "lives", "kills",
    "has the ball", "is hunted", "passes", "blink ready", "pointed at", "from the pointer x", "from the pointer z",
]  # fmt: skip
BEAST = [
    "x",
    "z",
    "place x",
    "place z",
    "heading x",
    "heading z",
    "body x",
    "body z",
    "speed",
    "turning",
    "hunts",
    "boost",
    "touches",
]
BALL = ["held", "flying", "x", "z", "height", "speed", "hold", "charge", "own pass", "from the center"]
MATCH = ["start", "hunt", "dead", "revival", "phase", "decisions", "players"]


def sensors(players: int) -> list[pb.Sensor]:
    """Return the sensors of an agent in a match of so many players."""
    rivals = players - 1
    low, high = _bounds(OWN, 2.0)
    rival_low, rival_high = _bounds(RIVAL * rivals, 2.2)
    slots = [f"{k} {name}" for k in range(rivals) for name in RIVAL]
    return [
        sensor("own", [len(OWN)], low, high, "the own player; the goal is relative to it", elements=OWN),
        sensor("pointer", [len(POINTER)], -1.1, 1.1, "the pointer, and whether it is on a player", elements=POINTER),
        sensor(
            "rivals",
            [rivals, len(RIVAL)],
            rival_low,
            rival_high,
            "the rivals, relative to the own player and to the pointer (1 is how far it gets in a decision); nearest "
            "to it first",
            elements=slots,
        ),
        sensor(
            "beast", [len(BEAST)], -MAX_DISTANCE, MAX_DISTANCE, "the beast, relative to the own player", elements=BEAST
        ),
        sensor("ball", [len(BALL)], -2.2, 2.2, "the ball, relative to the own player", elements=BALL),
        sensor("match", [len(MATCH)], 0.0, 1.0, "the phase of the match, and what is left of it", elements=MATCH),
    ]


def _bounds(names: list[str], usual: float) -> tuple[list[float], list[float]]:
    """Return the bounds of values with these names; those of kills are larger."""
    kills = [name == "kills" for name in names]
    return [-3.0 if one else -usual for one in kills], [10.0 if one else usual for one in kills]


@compiled
def observe(arenas, rules, agents, own, pointer, rivals, beast, ball, match):
    """Write the sensors of the first `agents` players of every arena, [lanes, *shape] each."""
    order = np.zeros(MAX_PLAYERS, np.int64)
    for i in range(len(arenas)):
        for j in range(agents):
            lane = i * agents + j
            found = _observe_pointer(arenas[i], j, rules, pointer[lane])
            _observe_own(arenas[i], j, rules, own[lane])
            _sort_rivals(arenas[i], j, rules, order)
            for k in range(rules.players - 1):
                _observe_rival(arenas[i], j, order[k], rules, rivals[lane, k])
                rivals[lane, k, 14] = 1.0 if order[k] == found else 0.0
            _observe_beast(arenas[i], j, beast[lane])
            _observe_ball(arenas[i], j, ball[lane])
            _observe_match(arenas[i], rules, match[lane])


@compiled
def _observe_pointer(arena, j, rules, values):
    """Write values [6]. Returns which player is under the pointer, -1 if none."""
    player = arena.players[j]
    found = under(arena, j, player.pointer_x, player.pointer_z, rules)
    values[0], values[1] = player.pointer_x / PLACE_UNIT, player.pointer_z / PLACE_UNIT
    values[2], values[3] = player.pointer_vx / TOP_SPEED, player.pointer_vz / TOP_SPEED
    values[4] = 1.0 if found == j else 0.0
    values[5] = 1.0 if found >= 0 and found != j else 0.0
    return found


@compiled
def _observe_own(arena, j, rules, values):
    """Write values [16]."""
    player = arena.players[j]
    cooldown = max(player.blink_ready - arena.tick, 0)
    values[0], values[1] = player.x / PLACE_UNIT, player.z / PLACE_UNIT
    values[2], values[3] = player.vx / PLAYER_SPEED, player.vz / PLAYER_SPEED
    values[4], values[5] = player.fx, player.fz
    values[6], values[7] = player.lives / max(rules.lives, 1), player.kills / KILLS_UNIT
    values[8] = 1.0 if arena.carrier == j else 0.0
    values[9] = 1.0 if arena.target == j else 0.0
    values[10] = 1.0 if player.pass_to >= 0 else 0.0
    values[11] = (player.throw_tick - arena.tick) / WIND_UP if player.throw_tick > 0 else 0.0
    values[12] = cooldown / BLINK_COOLDOWN
    values[13] = 1.0 if cooldown == 0 else 0.0
    values[14] = (player.goal_x - player.x) / PLACE_UNIT if player.has_goal else 0.0
    values[15] = (player.goal_z - player.z) / PLACE_UNIT if player.has_goal else 0.0


@compiled
def _sort_rivals(arena, j, rules, order):
    """Write the rivals of player j: the living ones, those nearest to its pointer first, then the others."""
    player = arena.players[j]
    distances = np.zeros(rules.players)
    for k in range(rules.players):
        rival = arena.players[k]
        distances[k] = length(rival.x - player.pointer_x, rival.z - player.pointer_z) if rival.alive else math.inf
    count = 0
    for k in range(rules.players):
        if k != j:
            place = count
            while place > 0 and distances[order[place - 1]] > distances[k]:
                order[place] = order[place - 1]
                place -= 1
            order[place] = k
            count += 1


@compiled
def _observe_rival(arena, j, k, rules, values):
    """Write values [17] but for "pointed at": what player j sees of player k."""
    player, rival = arena.players[j], arena.players[k]
    if rival.out:
        values[:] = 0.0
        return
    values[0] = 1.0
    values[1] = 1.0 if rival.alive else 0.0
    values[2], values[3] = (rival.x - player.x) / PLACE_UNIT, (rival.z - player.z) / PLACE_UNIT
    values[4], values[5] = rival.vx / PLAYER_SPEED, rival.vz / PLAYER_SPEED
    values[6], values[7] = rival.fx, rival.fz
    values[8], values[9] = rival.lives / max(rules.lives, 1), rival.kills / KILLS_UNIT
    values[10] = 1.0 if arena.carrier == k else 0.0
    values[11] = 1.0 if arena.target == k else 0.0
    values[12] = 1.0 if rival.pass_to >= 0 or rival.throw_tick > 0 else 0.0
    values[13] = 1.0 if arena.tick >= rival.blink_ready else 0.0
    values[15] = _near((rival.x - player.pointer_x) / REACH)
    values[16] = _near((rival.z - player.pointer_z) / REACH)


@compiled
def _observe_beast(arena, j, values):
    """Write values [13]."""
    player, beast = arena.players[j], arena.beast
    values[0], values[1] = _far((beast.x - player.x) / PLACE_UNIT), _far((beast.z - player.z) / PLACE_UNIT)
    values[2], values[3] = _far(beast.x / PLACE_UNIT), _far(beast.z / PLACE_UNIT)
    values[4], values[5], values[6], values[7] = beast.fx, beast.fz, beast.gx, beast.gz
    values[8], values[9] = _far(beast.speed / BEAST_SPEED), _far(beast.turning / TURNING_LIMIT)
    values[10] = 1.0 if arena.target >= 0 else 0.0
    values[11] = (beast.boost_tick - arena.tick) / BOOST_TICKS if beast.boost_tick > 0 else 0.0
    values[12] = 1.0 if player.touching else 0.0


@compiled
def _far(value):
    return min(max(value, -MAX_DISTANCE), MAX_DISTANCE)


@compiled
def _near(value):
    return min(max(value, -NEAR), NEAR)


@compiled
def _observe_ball(arena, j, values):
    """Write values [10]."""
    player, ball = arena.players[j], arena.ball
    values[:] = 0.0
    x, y, z = player.x, 0.0, player.z
    if arena.carrier >= 0:
        values[0] = 1.0
        x, y, z = arena.players[arena.carrier].x, HANDS, arena.players[arena.carrier].z
    elif ball.flying:
        values[1] = 1.0
        x, y, z = ball.x, ball.y, ball.z
        values[5] = ball.speed / SPEED_LIMIT
    values[2], values[3] = (x - player.x) / PLACE_UNIT, (z - player.z) / PLACE_UNIT
    values[4] = y / BALL_TOP
    values[6] = min(arena.hold / (2.0 * CHARGE_FROM), 2.0)
    values[7] = min(arena.charge / CHARGE_UNIT, 2.0)
    values[8] = 1.0 if arena.last == j else 0.0
    values[9] = 1.0 if arena.last < 0 else 0.0


@compiled
def _observe_match(arena, rules, values):
    """Write values [7]. At the end of an episode, the phase is that of its last tick."""
    left = arena.phase_tick - arena.tick if arena.phase != HUNT else 0
    revival = arena.phase == DEAD and left <= rules.revive_ticks
    remaining = 0
    for j in range(rules.players):
        remaining += 0 if arena.players[j].out else 1
    values[0] = 1.0 if arena.phase == START else 0.0
    values[1] = 1.0 if arena.phase == HUNT else 0.0
    values[2] = 1.0 if arena.phase == DEAD and not revival else 0.0
    values[3] = 1.0 if revival else 0.0
    values[4] = max(left, 0) / PHASE_TICKS
    values[5] = arena.tick / (MAX_DECISIONS * DECISION_TICKS)
    values[6] = remaining / rules.players
