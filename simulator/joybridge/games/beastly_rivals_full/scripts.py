"""Three scripts, which may play any player.

They run inside the simulator, because they need the whole state, cost no message there, and play the same matches
for every trainer. They give commands at once, without a pointer, which stays where it is. `play` and the scripts change
an arena's record, so Python can call them as well.
"""

import math

from joybridge.games.beastly_rivals_full.beast import gap
from joybridge.games.beastly_rivals_full.geometry import SEATS, length, project, unit
from joybridge.games.beastly_rivals_full.players import blink, move, pass_ball
from joybridge.games.beastly_rivals_full.state import MAX_CHARGE, PLAYER_RADIUS
from joybridge.simulator.compiled import compiled
from joybridge.simulator.trigonometry import arccosine

SCRIPTS = {
    "flee": "runs away from the beast, blinks to the other side if it is near, and never passes",
    "at_once": "passes at once, to the rival to which it has to turn least",
    "patient": "stays behind the beast, charges, and passes at the last moment",
}
FLEE, AT_ONCE, PATIENT = range(1, 1 + len(SCRIPTS))

DODGE, GAIN = 8.0, 32.0  # how far behind the beast a player goes to dodge it, and to gain time
AWAY = 15.0  # how far a player looks for a point to flee to; one that is nearer than NO_WAY is a wall
NO_WAY = 5.0
DANGER = 8.0  # distance from the beast's box at which a fleeing player blinks
THROW_SECONDS, MARGIN_SECONDS = 0.6, 0.25  # of a wind-up; what a patient player leaves for errors
PASS_CONE, PASS_TURN = 10.0, 250.0  # degrees, degrees/s
DEGREES = 180 / math.pi


@compiled
def play(arena, i, script, rules):
    """Give player i the command of a script in this decision."""
    player = arena.players[i]
    player.pointer_vx = player.pointer_vz = 0.0
    if not player.alive:
        return
    if arena.target != i:
        move(arena, i, SEATS[player.seat, 0], SEATS[player.seat, 1])
    elif script == FLEE:
        flee(arena, i)
    elif script == AT_ONCE:
        pass_at_once(arena, i, rules)
    else:
        wait_for_the_beast(arena, i, rules)


@compiled
def flee(arena, i):
    """Run away, and blink to the other side if the beast is near. Never pass."""
    if gap(arena.beast, arena.players[i]) < DANGER and arena.tick >= arena.players[i].blink_ready:
        blink(arena, i, -arena.beast.x, -arena.beast.z)
    else:
        x, z = _away(arena, i)
        move(arena, i, x, z)


@compiled
def pass_at_once(arena, i, rules):
    """Pass to the rival to which the player has to turn least; run away while the ball comes."""
    player = arena.players[i]
    if arena.carrier != i:
        x, z = _away(arena, i)
        move(arena, i, x, z)
    elif player.pass_to < 0 and player.throw_tick == 0:
        rival = _nearest_ahead(arena, i, player, rules)
        if rival >= 0:
            pass_ball(arena, i, rival)


@compiled
def wait_for_the_beast(arena, i, rules):
    """Stay behind the beast, charge, and pass at the last moment to the rival to which the beast turns least."""
    player, beast = arena.players[i], arena.beast
    if arena.carrier == i and player.pass_to < 0 and player.throw_tick == 0:
        rival = _nearest_ahead(arena, i, beast, rules)
        if rival >= 0:
            other = arena.players[rival]
            turn = _angle(player.fx, player.fz, other.x - player.x, other.z - player.z)
            needed = THROW_SECONDS + max(0.0, turn - PASS_CONE) / PASS_TURN
            turn = _angle(beast.fx, beast.fz, player.x - beast.x, player.z - beast.z)
            left = (gap(beast, player) - PLAYER_RADIUS) / max(beast.speed, 1e-9) + 0.5 * turn / max(beast.turning, 1e-9)
            if arena.charge >= MAX_CHARGE or left < needed + MARGIN_SECONDS:
                pass_ball(arena, i, rival)
                return
    if player.pass_to < 0:
        x, z = _behind(beast, DODGE)
        move(arena, i, x, z)


@compiled
def _behind(beast, distance):
    """Return the walkable point that is nearest to the one so far behind the beast."""
    return project(beast.x - distance * beast.fx, beast.z - distance * beast.fz)


@compiled
def _away(arena, i):
    """Return a point farther from the beast, or one behind it if there is a wall."""
    player, beast = arena.players[i], arena.beast
    ux, uz = unit(player.x - beast.x, player.z - beast.z, player.fx, player.fz)
    x, z = project(player.x + AWAY * ux, player.z + AWAY * uz)
    if length(x - player.x, z - player.z) >= NO_WAY:
        return x, z
    return _behind(beast, GAIN)


@compiled
def _nearest_ahead(arena, i, seer, rules):
    """Return the living rival of player i that a seer (it, or the beast) has to turn least to see; -1 if none lives."""
    found, largest = -1, -2.0
    for j in range(rules.players):
        other = arena.players[j]
        if j != i and other.alive:
            ux, uz = unit(other.x - seer.x, other.z - seer.z, seer.fx, seer.fz)
            cosine = seer.fx * ux + seer.fz * uz
            if cosine > largest:
                found, largest = j, cosine
    return found


@compiled
def _angle(fx, fz, x, z):
    """Return the angle between a direction f and the vector (x, z), in degrees."""
    ux, uz = unit(x, z, fx, fz)
    return arccosine(min(max(fx * ux + fz * uz, -1.0), 1.0)) * DEGREES
