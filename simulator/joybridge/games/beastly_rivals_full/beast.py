"""The beast: it turns to its target at a limited rate, grows, and kills with a box that trails behind it."""

import math

from joybridge.games.beastly_rivals_full.geometry import turn, unit
from joybridge.games.beastly_rivals_full.state import BOOST_TICKS, PLAYER_RADIUS, TICK
from joybridge.simulator.compiled import compiled
from joybridge.simulator.trigonometry import cosine, sine

START_SPEED, SPEED_GROWTH, SPEED_LIMIT = 10.0, 0.6, 75.0  # units/s; growth per s
START_TURNING, TURNING_GROWTH, TURNING_LIMIT = 50.0, 0.0005, 360.0  # degrees/s; growth per s, times the square
BODY_BEHIND, BOX_AHEAD, BOX_HALF = 3.0, 1.05, 0.75  # the body behind the root; the box in front of the body
REACH = BODY_BEHIND + BOX_AHEAD + 2.0 * BOX_HALF + PLAYER_RADIUS  # no player farther from the root is touched
BOOST_SHARE = 0.15  # factor on the beast per unit of charge
AFTER_BOOST_SPEED, AFTER_BOOST_TURNING = 1.05, 1.1  # factors on what the beast had at a power shot
DEGREE = math.pi / 180


@compiled
def calm(arena):
    """Give the beast the speed and turning with which each hunt begins; a boost is over."""
    arena.beast.boost_tick = 0
    arena.beast.speed = START_SPEED * arena.beast_speed
    arena.beast.turning = START_TURNING * arena.beast_turning


@compiled
def boost(arena, rules):
    """Change the beast for a power shot with the arena's charge; its growth until the boost ends is lost."""
    beast, factor = arena.beast, BOOST_SHARE * arena.charge
    if not rules.weak_shots_slow:
        factor = max(factor, 1.0)
    beast.saved_speed = beast.speed * AFTER_BOOST_SPEED
    beast.saved_turning = beast.turning * AFTER_BOOST_TURNING
    beast.speed *= factor
    beast.turning *= factor
    beast.boost_tick = arena.tick + BOOST_TICKS


@compiled
def end_boost(arena):
    """Give the beast what follows a boost, if it is due."""
    beast = arena.beast
    if beast.boost_tick == arena.tick:
        beast.speed, beast.turning, beast.boost_tick = beast.saved_speed, beast.saved_turning, 0


@compiled
def hunt(arena, rules):
    """Advance the beast by one tick. Returns the player that it kills, -1 if none."""
    beast = arena.beast
    vx = vz = 0.0
    if arena.target >= 0:
        target = arena.players[arena.target]
        ux, uz = unit(target.x - beast.x, target.z - beast.z, beast.fx, beast.fz)
        angle = min(beast.turning * TICK, 180.0) * DEGREE
        beast.fx, beast.fz, c, s = turn(beast.fx, beast.fz, ux, uz, cosine(angle), sine(angle))
        beast.gx, beast.gz = ux * c - uz * s, uz * c + ux * s  # the body looks at the target, then turns with the root
        vx, vz = beast.fx * beast.speed, beast.fz * beast.speed
        _grow(arena, rules)
    victim = _touch(arena, rules)
    beast.x += vx * TICK
    beast.z += vz * TICK
    return victim


@compiled
def _grow(arena, rules):
    beast = arena.beast
    speed_limit, turning_limit = SPEED_LIMIT * arena.beast_speed, TURNING_LIMIT * arena.beast_turning
    speed = beast.speed + SPEED_GROWTH * TICK * arena.beast_speed
    turning = beast.turning + TICK * beast.turning * beast.turning * TURNING_GROWTH / arena.beast_turning
    if rules.overshoots:
        beast.speed = speed if beast.speed <= speed_limit else speed_limit
        beast.turning = turning if beast.turning <= turning_limit else turning_limit
    else:
        beast.speed = min(speed, speed_limit)
        beast.turning = min(turning, turning_limit)


@compiled
def _touch(arena, rules):
    """Note which players the beast touches where it is. Returns the one that it kills, -1 if none."""
    beast, victim = arena.beast, -1
    for i in range(rules.players):
        player = arena.players[i]
        near = abs(player.x - beast.x) <= REACH and abs(player.z - beast.z) <= REACH
        touching = near and player.alive and gap(beast, player) <= PLAYER_RADIUS
        if touching and arena.carrier == i and arena.target >= 0 and not (player.touching and rules.enter_only):
            victim = i
        player.touching = touching
    return victim


@compiled
def gap(beast, player):
    """Return the distance from the beast's box to a player's center."""
    dx = player.x - (beast.x - BODY_BEHIND * beast.fx + BOX_AHEAD * beast.gx)
    dz = player.z - (beast.z - BODY_BEHIND * beast.fz + BOX_AHEAD * beast.gz)
    along = max(abs(dx * beast.gx + dz * beast.gz) - BOX_HALF, 0.0)
    aside = max(abs(dx * beast.gz - dz * beast.gx) - BOX_HALF, 0.0)
    return math.sqrt(along * along + aside * aside)
