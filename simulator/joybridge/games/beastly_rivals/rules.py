"""The rules of Beastly Rivals Onslaught: one tick, and one decision, of every arena.

The rules are those of the paper's game, reconstructed from the behavior that its trained networks expect. Each quirk of
the original is a switch in `Rules`; everything else is the same with the rules `original` and `corrected`.

The ground is the plane x-z with the pitch's center at (0, 0). Nothing moves vertically, but the bodies are at different
heights, and some distances of the original are measured in 3D.
"""

import math
from typing import NamedTuple

import numpy as np

from joybridge.contract.tensors import Array
from joybridge.games.beastly_rivals.pitches import BOUNDARY_RADIUS, PITCH_RADIUS, Pitches, block, hold_inside
from joybridge.games.level_sets import draw_level
from joybridge.simulator.compiled import compiled
from joybridge.simulator.randomness import Streams, reserve, uniform
from joybridge.simulator.trigonometry import cosine, sine

TICK = 0.02  # s
DECISION_TICKS = 6
CLOCK_TICKS = 12000  # all arenas start over together after this many
TOP_SPEED = 20.0  # of the cursor, units/s

CURSOR_HEIGHT, CHARACTER_HEIGHT, BEAST_HEIGHT = 1.0, 0.3, 0.175
BEAST_BELOW = CHARACTER_HEIGHT - BEAST_HEIGHT

CHARACTER_SPEED = 4.0
CHARACTER_RADIUS = 0.28125
COOLDOWN_TICKS = 200  # between two blinks

START_SPEED, SPEED_GROWTH, SPEED_LIMIT = 0.8, 0.001, 8.5  # of the beast; growth per tick
START_ACCURACY, ACCURACY_GROWTH, ACCURACY_LIMIT = 0.01, 0.000055, 0.75
BOX_AHEAD, BOX_HALF, BOX_HALF_UP = 0.275, 0.1925, 1.1  # its box: the center's distance in front, half sizes
KILL_DISTANCE = BOX_AHEAD + BOX_HALF + CHARACTER_RADIUS  # in 3D: the box always faces the character

SPHERE_TURN_SECONDS, SPHERE_PULL, SPHERE_INERTIA = 3.0, 0.8, 0.2
SLOWEST, BEAST_EASE = 0.5, 0.1  # lowest factor on a speed in the sphere; what is added to the beast's

SURVIVAL, DEATH, EARLY_BLINK = range(3)  # reward channels
SURVIVAL_REWARD, DEATH_REWARD, EARLY_BLINK_REWARD = 0.01, -1.0, -0.025


class Rules(NamedTuple):
    """The quirks of the original, and the option `slow_character`."""

    blink_repeats: bool  # a blink is tried in every tick of its decision: five early ones follow a success
    never_arrives: bool  # the distance to the goal is in 3D: the character slows down near it and never stops
    velocities_survive: bool  # cursor, character and beast begin an episode with their last velocities
    overlaps_survive: bool  # an overlap at the end of an episode is not noticed again until it has ended
    slow_character: bool  # the sphere slows the character; not in the original's game of two agents


ORIGINAL = Rules(True, True, True, True, True)
CORRECTED = Rules(False, False, False, False, True)


class World(NamedTuple):
    """What all arenas of a session share."""

    rules: Rules
    pitches: Pitches
    generated: bool  # each arena's row of the pitches is its own


BODY = np.dtype([("x", "f8"), ("z", "f8"), ("vx", "f8"), ("vz", "f8")])
ARENA = np.dtype(
    [
        ("cursor", BODY), ("character", BODY), ("beast", BODY), ("sphere", BODY),
        ("heading", "f8"),  # rad; only the locomotion "steer" turns it
        ("goal_x", "f8"), ("goal_z", "f8"), ("moving", "?"),  # where the character goes, and whether it moves
        ("cooldown", "i8"),  # ticks until the character may blink
        ("speed", "f8"), ("accuracy", "f8"),  # of the beast
        ("timer", "f4"),  # s since the sphere turned; its rounding in single precision matters, see _turn_sphere
        ("character_slow", "?"), ("beast_slow", "?"), ("dead", "?"),
        ("character_inside", "?"), ("beast_inside", "?"), ("touching", "?"),  # overlaps at the last tick
        ("blinks", "i8"), ("clicks", "i8"), ("slow_ticks", "i8"),  # of this episode
        ("tick", "i8"), ("clock", "i8"),  # ticks of this episode; ticks since all arenas started over
        ("level", "i8"), ("number", "i8"),  # row of the pitches; number of a generated one
        ("beast_speed", "f8"),  # a parameter: factor on the beast's speed
        ("first_level", "f8"), ("level_count", "f8"),  # parameters
    ]
)  # fmt: skip

# The most random numbers that one arena draws per call: one turn of the sphere, and a new episode.
MOST_DRAWS, LEVEL_DRAWS = 2 + 6, 1


def begin(arenas: Array, streams: Streams, world: World) -> None:
    """Fill arenas, zeros but for the parameters, as at the start of the program: all at rest, and a first episode."""
    reserve_draws(streams, world)
    begin_episodes(arenas, streams, world, np.ones(len(arenas), bool))


def reserve_draws(streams: Streams, world: World) -> None:
    """Reserve the most random numbers that one arena draws per call."""
    reserve(streams, MOST_DRAWS + (LEVEL_DRAWS if world.generated else 0))


@compiled
def begin_episodes(arenas, streams, world, which):
    """Begin a new episode in the arenas of `which` [arenas]; a clock at its end is set to 0."""
    for i in range(len(arenas)):
        if which[i]:
            begin_episode(arenas[i], streams, i, world)


@compiled
def settle(arenas, world, which):
    """Put the bodies of the arenas of `which` [arenas] where their generated pitches, which are made now, have room."""
    for i in range(len(arenas)):
        if which[i]:
            _keep_on_pitch(arenas[i], world.pitches)


@compiled
def _keep_on_pitch(arena, pitches):
    """Keep all but the beast within the edges, and character and beast out of pillars."""
    level, edges, pillars = arena.level, pitches.edges, pitches.pillars
    for j in range(pitches.edge_counts[level]):
        x, z, distance = edges[level, j, 0], edges[level, j, 1], edges[level, j, 2]
        hold_inside(arena.cursor, x, z, distance)
        hold_inside(arena.sphere, x, z, distance)
        hold_inside(arena.character, x, z, distance)
    for j in range(pitches.pillar_counts[level]):
        x, z, radius = pillars[level, j, 0], pillars[level, j, 1], pillars[level, j, 2]
        block(arena.character, x, z, radius + CHARACTER_RADIUS)
        block(arena.beast, x, z, radius + BOX_HALF)


@compiled
def begin_episode(arena, streams, i, world):
    """Put the bodies of arena i at new places. The sphere keeps its velocity and timer with all rules."""
    rules = world.rules
    if world.generated:
        arena.level, arena.number = i, draw_level(arena, streams, i)
    _put_on_pitch(arena.character, streams, i)
    _put_on_pitch(arena.cursor, streams, i)
    _put_on_pitch(arena.sphere, streams, i)
    arena.beast.x = arena.beast.z = 0.0
    arena.speed = START_SPEED * arena.beast_speed
    arena.accuracy = START_ACCURACY
    arena.cooldown = 0
    arena.moving = arena.character_slow = arena.beast_slow = arena.dead = False
    if not rules.velocities_survive:
        _stop(arena.cursor)
        _stop(arena.character)
        _stop(arena.beast)
    if not rules.overlaps_survive:
        arena.character_inside = arena.beast_inside = arena.touching = False
    arena.blinks = arena.clicks = arena.slow_ticks = arena.tick = 0
    if arena.clock >= CLOCK_TICKS:
        arena.clock = 0


@compiled
def _draw_place(streams, i):
    """Return a random point (x, z), uniform on the pitch."""
    radius = PITCH_RADIUS * math.sqrt(uniform(streams, i, 0.0, 1.0))
    angle = uniform(streams, i, 0.0, 2.0 * np.pi)
    return radius * cosine(angle), radius * sine(angle)


@compiled
def _put_on_pitch(body, streams, i):
    body.x, body.z = _draw_place(streams, i)


@compiled
def _stop(body):
    body.vx = body.vz = 0.0


@compiled
def decide(arenas, streams, world, velocity, move, blink, rewards, ticks):
    """Advance every arena by the first ticks of a decision: its action in each of them, death or not. See `tick`."""
    for number in range(ticks):
        tick(arenas, streams, world, number, velocity, move, blink, rewards)
    for i in range(len(arenas)):
        arenas[i].clicks += 1 if move[i] or blink[i] else 0


@compiled
def tick(arenas, streams, world, number, velocity, move, blink, rewards):
    """Advance every arena by tick `number` of a decision and add to `rewards` [arenas, channels].

    velocity is the commanded one of the cursor [arenas, 2], move and blink are [arenas] of 0 or 1. Episodes
    that end are left as they are: the caller observes them, then begins new ones.
    """
    rules, pitches = world.rules, world.pitches
    for i in range(len(arenas)):
        arena = arenas[i]
        sphere_radius, sphere_speed = pitches.sphere[arena.level, 0], pitches.sphere[arena.level, 1]
        _move_or_blink(arena, move[i], blink[i] and (number == 0 or rules.blink_repeats), rewards[i])
        arena.cursor.vx, arena.cursor.vz = velocity[i, 0], velocity[i, 1]
        _confine(arena.cursor, CURSOR_HEIGHT)
        arena.cooldown = max(arena.cooldown - 1, 0)
        _drive_character(arena, rules, sphere_radius)
        _steer_beast(arena, sphere_radius)
        _grow_beast(arena)
        _confine(arena.sphere, 0.0)
        _turn_sphere(arena, streams, i, sphere_speed)
        _meet(arena, rules, sphere_radius, rewards[i])  # before the bodies move, as in the original engine
        for body in (arena.cursor, arena.character, arena.beast, arena.sphere):
            body.x += body.vx * TICK
            body.z += body.vz * TICK
        if world.generated:
            _keep_on_pitch(arena, pitches)
        rewards[i, SURVIVAL] += SURVIVAL_REWARD
        arena.tick += 1
        arena.clock += 1


@compiled
def _move_or_blink(arena, move, blink, rewards):
    """Send the character to the cursor; for a blink, put it there, which ends the walk."""
    if move:
        arena.goal_x, arena.goal_z = arena.cursor.x, arena.cursor.z
        arena.moving = True
    if not blink:
        return
    if arena.cooldown > 0:
        rewards[EARLY_BLINK] += EARLY_BLINK_REWARD
        return
    arena.character.x, arena.character.z = arena.cursor.x, arena.cursor.z
    arena.moving = False
    arena.cooldown = COOLDOWN_TICKS
    arena.blinks += 1


@compiled
def _confine(body, height):
    """Pull a body outside the boundary sphere towards the center, onto the sphere, then restore its height.

    Above the ground, one pull is therefore not enough to bring it back. The velocity does not change.
    """
    distance = math.sqrt(body.x * body.x + body.z * body.z + height * height)
    if distance > BOUNDARY_RADIUS:
        body.x *= BOUNDARY_RADIUS / distance
        body.z *= BOUNDARY_RADIUS / distance


@compiled
def _drive_character(arena, rules, sphere_radius):
    """Set the character's velocity: towards its goal, slower in the sphere, 0 if it does not move."""
    character = arena.character
    share = _slow_share(character, arena.sphere, sphere_radius, 0.0) if arena.character_slow else 1.0
    arena.slow_ticks += 1 if share < 1.0 else 0
    dx, dz = arena.goal_x - character.x, arena.goal_z - character.z
    square = dx * dx + dz * dz
    if not arena.moving or square == 0.0:
        _stop(character)
        return
    if rules.never_arrives:
        per_unit = CHARACTER_SPEED / math.sqrt(square + CHARACTER_HEIGHT * CHARACTER_HEIGHT)
    else:
        per_unit = min(CHARACTER_SPEED / math.sqrt(square), 1.0 / TICK)  # at most to the goal
    character.vx, character.vz = dx * per_unit * share, dz * per_unit * share


@compiled
def _slow_share(body, sphere, sphere_radius, ease):
    """Return the factor of the slow sphere on a body's speed; it is lowest at the sphere's center."""
    dx, dz = body.x - sphere.x, body.z - sphere.z
    return min(max(math.sqrt(dx * dx + dz * dz) / sphere_radius + ease, SLOWEST), 1.0)


@compiled
def _steer_beast(arena, sphere_radius):
    """Turn the beast's velocity towards the character; less if the accuracy is lower or the speed higher.

    The pull is a unit vector in 3D that points slightly upwards; the upward part of the velocity is dropped.
    """
    beast = arena.beast
    dx, dz = arena.character.x - beast.x, arena.character.z - beast.z
    distance = math.sqrt(dx * dx + dz * dz + BEAST_BELOW * BEAST_BELOW)
    speed = math.sqrt(beast.vx * beast.vx + beast.vz * beast.vz)
    ahead_x = beast.vx / speed if speed > 0.0 else 0.0
    ahead_z = beast.vz / speed if speed > 0.0 else 0.0
    wx = beast.vx + arena.accuracy * (dx / distance - ahead_x)
    wz = beast.vz + arena.accuracy * (dz / distance - ahead_z)
    wy = arena.accuracy * BEAST_BELOW / distance
    per_unit = arena.speed / math.sqrt(wx * wx + wy * wy + wz * wz)
    if arena.beast_slow:
        per_unit *= _slow_share(beast, arena.sphere, sphere_radius, BEAST_EASE)
    beast.vx, beast.vz = wx * per_unit, wz * per_unit


@compiled
def _grow_beast(arena):
    """Increase the beast's speed and accuracy by one tick's growth."""
    arena.speed = min(arena.speed + SPEED_GROWTH * arena.beast_speed, SPEED_LIMIT * arena.beast_speed)
    arena.accuracy = min(arena.accuracy + ACCURACY_GROWTH, ACCURACY_LIMIT)


@compiled
def _turn_sphere(arena, streams, i, sphere_speed):
    """Every three seconds, turn the slow sphere towards a random place on the pitch.

    The timer is compared before it is increased, and its rounded sum reaches 3 one tick late: the first turn is in
    tick 152, the others follow every 151 ticks.
    """
    if arena.timer >= SPHERE_TURN_SECONDS:
        arena.timer = 0.0
        sphere = arena.sphere
        x, z = _draw_place(streams, i)
        dx, dz = x - sphere.x, z - sphere.z
        distance = math.sqrt(dx * dx + dz * dz)
        pull = SPHERE_PULL / distance if distance > 0.0 else 0.0
        wx = pull * dx + SPHERE_INERTIA * sphere.vx
        wz = pull * dz + SPHERE_INERTIA * sphere.vz
        length = math.sqrt(wx * wx + wz * wz)
        per_unit = sphere_speed / length if length > 0.0 else 0.0
        sphere.vx, sphere.vz = wx * per_unit, wz * per_unit
    arena.timer += np.float32(TICK)


@compiled
def _meet(arena, rules, sphere_radius, rewards):
    """Compare overlaps with those of the last tick; only their changes have an effect."""
    touching = _touching(arena.beast, arena.character)
    if touching and not arena.touching:
        arena.dead = True
        rewards[DEATH] += DEATH_REWARD
    arena.touching = touching
    inside = _character_inside(arena.character, arena.sphere, sphere_radius)
    if inside != arena.character_inside:
        arena.character_inside = inside
        arena.character_slow = inside and rules.slow_character
    inside = _beast_inside(arena.beast, arena.character, arena.sphere, sphere_radius)
    if inside != arena.beast_inside:
        arena.beast_inside = arena.beast_slow = inside


@compiled
def _touching(beast, character):
    """Return whether the beast's box overlaps the character."""
    dx, dz = character.x - beast.x, character.z - beast.z
    return dx * dx + dz * dz + BEAST_BELOW * BEAST_BELOW <= KILL_DISTANCE * KILL_DISTANCE


@compiled
def _character_inside(character, sphere, sphere_radius):
    """Return whether the character overlaps the slow sphere, which lies on the ground."""
    dx, dz = character.x - sphere.x, character.z - sphere.z
    reach = sphere_radius + CHARACTER_RADIUS
    return dx * dx + dz * dz + CHARACTER_HEIGHT * CHARACTER_HEIGHT <= reach * reach


@compiled
def _beast_inside(beast, character, sphere, sphere_radius):
    """Return whether the beast's box, turned and tilted towards the character, overlaps the slow sphere."""
    dx, dz = character.x - beast.x, character.z - beast.z
    planar = math.sqrt(dx * dx + dz * dz)
    distance = math.sqrt(planar * planar + BEAST_BELOW * BEAST_BELOW)
    facing_x = dx / planar if planar > 0.0 else 1.0
    facing_z = dz / planar if planar > 0.0 else 0.0
    # The sphere's center in the box's frame: first turned, then tilted.
    dx, dz = sphere.x - beast.x, sphere.z - beast.z
    forward = dx * facing_x + dz * facing_z
    sideways = dx * facing_z - dz * facing_x
    upward = -BEAST_HEIGHT
    tilt_cosine, tilt_sine = planar / distance, BEAST_BELOW / distance
    ahead = forward * tilt_cosine + upward * tilt_sine - BOX_AHEAD
    above = upward * tilt_cosine - forward * tilt_sine
    gap_ahead = max(abs(ahead) - BOX_HALF, 0.0)
    gap_sideways = max(abs(sideways) - BOX_HALF, 0.0)
    gap_above = max(abs(above) - BOX_HALF_UP, 0.0)
    square = gap_ahead * gap_ahead + gap_sideways * gap_sideways + gap_above * gap_above
    return square <= sphere_radius * sphere_radius
