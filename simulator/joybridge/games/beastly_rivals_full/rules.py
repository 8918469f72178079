"""The rules of the complete Beastly Rivals Onslaught: an episode's beginning, one decision, one tick, deaths, rewards.

They are those of the public game, reconstructed in numbers. Each quirk of the original is a flag of `Rules`.
"""

import numpy as np

from joybridge.games.beastly_rivals_full.ball import charge, drop, fly, throw
from joybridge.games.beastly_rivals_full.beast import calm, end_boost, hunt
from joybridge.games.beastly_rivals_full.geometry import SEATS, project, unit
from joybridge.games.beastly_rivals_full.players import click, follow_commands, land, stop, walk
from joybridge.games.beastly_rivals_full.scripts import play
from joybridge.games.beastly_rivals_full.state import (
    CHANNELS,
    DEAD,
    DECISION_TICKS,
    HUNT,
    MAX_DECISIONS,
    MAX_PLAYERS,
    OVER,
    START,
    TICK,
)
from joybridge.simulator.compiled import compiled
from joybridge.simulator.randomness import integer

TOP_SPEED = 120.0  # of a pointer, units/s
POINTER_X, POINTER_Z = 47.0, 38.0  # largest distance of a pointer from the pitch's center
REVIVAL_X, REVIVAL_Z = 45, 40  # players are revived at whole numbers from minus this to one less

SURVIVAL, KILL, DEATH, HUMILIATION, PLACEMENT, BALL = range(CHANNELS)
SURVIVAL_REWARD, BALL_REWARD = 0.01, -0.01  # per tick

# Random numbers that one arena draws per call at most: seats, then those of one revival.
MAX_DRAWS = (MAX_PLAYERS - 1) + 3


@compiled
def begin_episodes(arenas, streams, rules, which):
    """Begin a match in the arenas of `which` [arenas], which are zeros but for the parameters."""
    for i in range(len(arenas)):
        if which[i]:
            begin_episode(arenas[i], streams, i, rules)


@compiled
def begin_episode(arena, streams, i, rules):
    """Put the players of arena i on random seats, and the beast in the middle; both wait for the first ball."""
    arena.carrier = arena.target = arena.last = arena.victim = -1
    arena.phase, arena.phase_tick = START, rules.start_ticks
    arena.beast.fz = arena.beast.gz = 1.0
    calm(arena)
    seats = np.arange(MAX_PLAYERS)
    _shuffle(seats, MAX_PLAYERS, streams, i)
    for j in range(MAX_PLAYERS):
        player = arena.players[j]
        player.pass_to = player.throw_to = -1
        player.out = j >= rules.players
        player.alive = not player.out
        if player.out:
            continue
        seat = seats[j]
        player.seat, player.lives = seat, rules.lives
        player.x, player.z = SEATS[seat, 0], SEATS[seat, 1]
        player.pointer_x, player.pointer_z = player.x, player.z
        player.fx, player.fz = unit(-player.x, -player.z, 0.0, 1.0)


@compiled
def _shuffle(values, count, streams, i):
    """Put the first `count` values in a random order."""
    for k in range(count - 1, 0, -1):
        other = integer(streams, i, k + 1)
        values[k], values[other] = values[other], values[k]


@compiled
def decide(arenas, streams, rules, velocity, clicks, scripts, rewards, ticks):
    """Advance every arena by the first ticks of a decision. Episodes that end are left as they are, with all paid.

    velocity [lanes, 2] is the commanded one of the pointers, clicks [lanes] are 0, 1 or 2 for a double click; those of
    lanes that wait are ignored. scripts [lanes]: 0, or which script plays instead, see scripts.py. rewards [lanes,
    channels] is written: zeros for lanes that wait.
    """
    gained, playing = np.zeros((rules.players, CHANNELS)), np.zeros(rules.players, np.bool_)
    for i in range(len(arenas)):
        arena, first = arenas[i], i * rules.players
        for j in range(rules.players):
            playing[j] = not arena.players[j].out
        for j in range(rules.players):
            if scripts[first + j] > 0:
                play(arena, j, scripts[first + j], rules)
            else:
                _act(arena, j, velocity[first + j], clicks[first + j], rules)
        gained[:] = 0.0
        for _ in range(ticks):
            tick(arena, streams, i, rules, gained)
            if arena.phase == OVER:
                break
        ends = ended(arena)
        if ends and arena.phase != OVER:
            _rank_the_remaining(arena, rules, gained)
        if rules.zero_sum:
            _compare(gained, playing)
        for j in range(rules.players):
            player = arena.players[j]
            for channel in range(CHANNELS):
                player.earned[channel] += gained[j, channel]
                rewards[first + j, channel] = player.earned[channel] if player.alive or ends else 0.0
            if player.alive or ends:
                player.earned[:] = 0.0


@compiled
def ended(arena):
    """Return whether an arena's episode has ended: its match is over, or it has reached the limit of decisions."""
    return arena.phase == OVER or arena.tick >= MAX_DECISIONS * DECISION_TICKS


@compiled
def _act(arena, j, velocity, clicks, rules):
    """Obey the action of player j: first its click, where the pointer was when the player saw it; then it moves."""
    player = arena.players[j]
    if not player.alive:
        player.pointer_vx = player.pointer_vz = 0.0
        return
    if clicks > 0:
        click(arena, j, clicks == 2, rules)
    player.pointer_vx, player.pointer_vz = velocity[0], velocity[1]
    x = player.pointer_x + velocity[0] * TICK * DECISION_TICKS
    z = player.pointer_z + velocity[1] * TICK * DECISION_TICKS
    player.pointer_x = min(max(x, -POINTER_X), POINTER_X)
    player.pointer_z = min(max(z, -POINTER_Z), POINTER_Z)


@compiled
def tick(arena, streams, i, rules, gained):
    """Advance arena i by one tick and add to `gained` [players, channels]. The order is that of the original."""
    arena.tick += 1
    victim = hunt(arena, rules)
    if victim >= 0:
        _kill(arena, victim, rules, gained)
    if arena.phase != OVER:
        walk(arena, rules)
        follow_commands(arena, rules)
        charge(arena)
        if arena.carrier >= 0:
            gained[arena.carrier, BALL] += BALL_REWARD
        fly(arena)
        _throw_what_is_due(arena, rules)
        if arena.phase != HUNT and arena.phase_tick == arena.tick:
            _go_on(arena, streams, i, rules)
        end_boost(arena)
        land(arena, rules)
    for j in range(rules.players):
        player = arena.players[j]
        if player.alive:
            player.ticks_alive += 1
            gained[j, SURVIVAL] += SURVIVAL_REWARD


@compiled
def _throw_what_is_due(arena, rules):
    """Throw the ball at the end of its carrier's wind-up; without the ball, a wind-up has no effect."""
    for i in range(rules.players):
        player = arena.players[i]
        if player.throw_tick == arena.tick:
            player.throw_tick, player.pass_to = 0, -1
            if arena.carrier == i:
                throw(arena, i, player.throw_to, rules)


@compiled
def _kill(arena, i, rules, gained):
    """Kill the carrier i. Who threw to it gets the credit; after the ball from the center, the death humiliates it."""
    player = arena.players[i]
    arena.target = -1
    drop(arena)
    stop(player)
    player.alive = player.touching = False
    player.pass_to, player.throw_tick = -1, 0
    player.deaths += 1
    gained[i, DEATH] -= 1.0
    if arena.last >= 0:
        arena.players[arena.last].kills += 1
        gained[arena.last, KILL] += 1.0
    else:
        player.kills -= 1
        player.humiliations += 1
        gained[i, HUMILIATION] -= 1.0
    arena.phase, arena.phase_tick, arena.victim = DEAD, arena.tick + rules.dead_ticks + rules.revive_ticks, i
    if player.lives > 0:
        player.lives -= 1
        return
    arena.victim = -1
    player.out, player.out_tick = True, arena.tick
    remaining = _remaining(arena, rules)
    _place(arena, i, remaining + 1.0, rules, gained)
    if remaining == 1:
        arena.phase = OVER
        for j in range(rules.players):
            if not arena.players[j].out:
                _place(arena, j, 1.0, rules, gained)


@compiled
def _remaining(arena, rules):
    """Return how many players are not out."""
    count = 0
    for j in range(rules.players):
        count += 0 if arena.players[j].out else 1
    return count


@compiled
def _place(arena, i, place, rules, gained):
    arena.players[i].place = place
    gained[i, PLACEMENT] += (rules.players + 1 - 2.0 * place) / (rules.players - 1)


@compiled
def _rank_the_remaining(arena, rules, gained):
    """Place those that are not out by lives, then by kills; equal ones share the mean of their places."""
    for i in range(rules.players):
        player, better, equal = arena.players[i], 0, 0
        for j in range(rules.players):
            other = arena.players[j]
            if other.out:
                continue
            if other.lives > player.lives or (other.lives == player.lives and other.kills > player.kills):
                better += 1
            equal += 1 if other.lives == player.lives and other.kills == player.kills else 0
        if not player.out:
            _place(arena, i, better + 0.5 * (equal + 1), rules, gained)


@compiled
def _compare(gained, playing):
    """Subtract from what each player gained the mean of what the others did.

    Who was out before is compared by its place only: it would be paid for a ball that it cannot get.
    """
    for channel in range(CHANNELS):
        total, compared = 0.0, 0
        for j in range(len(gained)):
            if playing[j] or channel == PLACEMENT:
                total += gained[j, channel]
                compared += 1
        for j in range(len(gained)):
            if not playing[j] and channel != PLACEMENT:
                gained[j, channel] = 0.0
            elif compared > 1:
                gained[j, channel] -= (total - gained[j, channel]) / (compared - 1)


@compiled
def _go_on(arena, streams, i, rules):
    """Revive the last victim, if it has lives, and throw a ball from the center to any player that is not out."""
    if arena.victim >= 0:
        player = arena.players[arena.victim]
        x = integer(streams, i, 2 * REVIVAL_X) - REVIVAL_X
        z = integer(streams, i, 2 * REVIVAL_Z) - REVIVAL_Z
        player.x, player.z = project(float(x), float(z))
        player.fx, player.fz = unit(-player.x, -player.z, player.fx, player.fz)
        player.vx = player.vz = 0.0
        player.alive = True
        arena.victim = -1
    calm(arena)
    number = integer(streams, i, _remaining(arena, rules))
    for j in range(rules.players):
        if not arena.players[j].out:
            if number == 0:
                throw(arena, -1, j, rules)
                break
            number -= 1
    arena.phase, arena.phase_tick = HUNT, 0
