"""What players do: the commands that they are given, and how they walk, push each other away, and turn to pass."""

import numpy as np

from joybridge.games.beastly_rivals_full.geometry import length, project, turn, unit
from joybridge.games.beastly_rivals_full.state import (
    BLINK_COOLDOWN,
    PLAYER_RADIUS,
    PLAYER_SPEED,
    TICK,
    WIND_UP,
)
from joybridge.simulator.compiled import compiled

SPEED_CHANGE = 100.0 * TICK  # most change of velocity per tick, units/s
BRAKE_DISTANCE = 4.0  # from which on a player becomes slower on the way to its goal
ARRIVAL, SHORT_MOVE = 0.5, 2.5
BLINK_TICKS = 15  # from the command to the landing
PUSH, PUSHES = 0.35, 4  # how much of an overlap of two players each gives way, and how often per tick
SLOWEST_TURN = 0.1  # units/s; slower players keep their heading

# Exact values, because those of the C library may differ between machines.
WALK_COSINE, WALK_SINE = 0.9781476007338057, 0.20791169081775934  # of 12°, what a walking player turns per tick
PASS_COSINE, PASS_SINE = 0.9961946980917455, 0.08715574274765817  # of 5°, what a passer turns per tick
CONE_COSINE = 0.984807753012208  # of 10°, within which a passer looks at its target


@compiled
def move(arena, i, x, z):
    """Send a player to a point, or to the walkable point that is nearest to it."""
    player = arena.players[i]
    if player.alive:
        player.goal_x, player.goal_z = project(x, z)
        player.has_goal = True


@compiled
def pass_ball(arena, i, j):
    """Make the carrier i turn to where the rival j is now, and throw the ball to it after a wind-up."""
    player, rival = arena.players[i], arena.players[j]
    if player.alive and arena.carrier == i and i != j and rival.alive:
        stop(player)
        player.pass_to, player.pass_x, player.pass_z = j, rival.x, rival.z


@compiled
def blink(arena, i, x, z):
    """Make a player appear at the walkable point that is nearest to (x, z), a little later. Returns whether it can."""
    player = arena.players[i]
    if not player.alive or arena.tick < player.blink_ready:
        return False
    stop(player)
    player.blink_x, player.blink_z = project(x, z)
    player.blink_tick = arena.tick + 1 + BLINK_TICKS
    player.blink_ready = arena.tick + 1 + BLINK_COOLDOWN
    player.blinks += 1
    return True


@compiled
def stop(player):
    """End a player's walk."""
    player.has_goal = player.walking = False


@compiled
def under(arena, i, x, z, rules):
    """Return which player a point shows to player i: the nearest rival that covers it, else itself, else -1."""
    found, nearest = -1, PLAYER_RADIUS
    for j in range(rules.players):
        player = arena.players[j]
        if j != i and player.alive:
            distance = length(player.x - x, player.z - z)
            if distance < nearest or (distance == nearest and found < 0):
                found, nearest = j, distance
    player = arena.players[i]
    if found < 0 and player.alive and length(player.x - x, player.z - z) <= PLAYER_RADIUS:
        return i
    return found


@compiled
def click(arena, i, double, rules):
    """Do what a click of player i means: pass to the rival under the pointer, else walk there, or blink if double."""
    player = arena.players[i]
    player.clicks += 1
    found = under(arena, i, player.pointer_x, player.pointer_z, rules)
    if found >= 0:
        pass_ball(arena, i, found)  # to itself: nothing happens
    elif double:
        blink(arena, i, player.pointer_x, player.pointer_z)
    else:
        move(arena, i, player.pointer_x, player.pointer_z)


@compiled
def walk(arena, rules):
    """Move all players by one tick, those that cannot act as well: they slide to a stop."""
    for i in range(rules.players):
        player = arena.players[i]
        if not player.walking and player.vx == 0.0 and player.vz == 0.0:
            continue
        wanted_x = wanted_z = 0.0
        if player.walking:
            dx, dz = player.path_x - player.x, player.path_z - player.z
            distance = length(dx, dz)
            if distance > 1e-6:
                per_unit = PLAYER_SPEED * min(1.0, distance / BRAKE_DISTANCE) / distance
                wanted_x, wanted_z = dx * per_unit, dz * per_unit
        change_x, change_z = wanted_x - player.vx, wanted_z - player.vz
        change = length(change_x, change_z)
        if change > 0.0:
            share = min(1.0, SPEED_CHANGE / change)
            player.vx += change_x * share
            player.vz += change_z * share
        player.x += player.vx * TICK
        player.z += player.vz * TICK
        if player.walking and length(player.vx, player.vz) > SLOWEST_TURN:
            ux, uz = unit(player.vx, player.vz, player.fx, player.fz)
            player.fx, player.fz, _, _ = turn(player.fx, player.fz, ux, uz, WALK_COSINE, WALK_SINE)
    for _ in range(PUSHES):
        if not _push_apart(arena, rules):
            break
    for i in range(rules.players):
        player = arena.players[i]
        player.x, player.z = project(player.x, player.z)


@compiled
def _push_apart(arena, rules):
    """Move overlapping players away from each other, all at once. Returns whether there were any."""
    pushed = False
    for i in range(1, rules.players):
        for j in range(i):
            pushed = pushed or _overlap(arena.players[i], arena.players[j])
    if not pushed:
        return False
    shifts = np.zeros((rules.players, 2))
    for i in range(rules.players):
        player, contacts = arena.players[i], 0
        for j in range(rules.players):
            other = arena.players[j]
            if i == j or not _overlap(player, other):
                continue
            dx, dz = player.x - other.x, player.z - other.z
            distance = length(dx, dz)
            if distance > 1e-4:
                dx, dz = dx / distance, dz / distance
            else:
                dx, dz = (1.0 if i < j else -1.0), 0.0
            shifts[i, 0] += dx * (2.0 * PLAYER_RADIUS - distance) * PUSH
            shifts[i, 1] += dz * (2.0 * PLAYER_RADIUS - distance) * PUSH
            contacts += 1
        shifts[i] /= max(contacts, 1)
    for i in range(rules.players):
        arena.players[i].x += shifts[i, 0]
        arena.players[i].z += shifts[i, 1]
    return True


@compiled
def _overlap(one, other):
    if not (one.alive and other.alive):
        return False
    return length(one.x - other.x, one.z - other.z) < 2.0 * PLAYER_RADIUS


@compiled
def follow_commands(arena, rules):
    """Let living players begin or end their walks, and turn those that pass; who looks at its target winds up."""
    for i in range(rules.players):
        player = arena.players[i]
        if not player.alive:
            continue
        if player.has_goal:
            distance = length(player.goal_x - player.x, player.goal_z - player.z)
            if distance < ARRIVAL:
                stop(player)
            elif distance >= (SHORT_MOVE if rules.ignores_short_moves else ARRIVAL):
                player.path_x, player.path_z = player.goal_x, player.goal_z
                player.walking = True
        if player.pass_to >= 0:
            ux, uz = unit(player.pass_x - player.x, player.pass_z - player.z, player.fx, player.fz)
            player.fx, player.fz, _, _ = turn(player.fx, player.fz, ux, uz, PASS_COSINE, PASS_SINE)
            player.throw_to = player.pass_to
            if player.fx * ux + player.fz * uz >= CONE_COSINE:
                player.pass_to = -1
                if player.throw_tick == 0:
                    player.throw_tick = arena.tick + WIND_UP


@compiled
def land(arena, rules):
    """End the blinks that are due: the players look where they went. Who has died meanwhile lands as well."""
    for i in range(rules.players):
        player = arena.players[i]
        if player.blink_tick == arena.tick:
            dx, dz = player.blink_x - player.x, player.blink_z - player.z
            player.fx, player.fz = unit(dx, dz, player.fx, player.fz)
            player.x, player.z = player.blink_x, player.blink_z
            player.blink_tick = 0
