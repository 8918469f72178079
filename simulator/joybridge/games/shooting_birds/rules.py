"""The rules of Shooting Birds: one tick of every arena.

The rules are those of the paper's game, reconstructed from the behavior that its trained networks expect. Each quirk of
the original is a switch in `Rules`; everything else is the same with the rules `original` and `corrected`.
"""

from typing import Any, NamedTuple

import numpy as np

from joybridge.contract.tensors import Array
from joybridge.games.level_sets import draw_level
from joybridge.games.shooting_birds import camera, foes
from joybridge.games.shooting_birds.levels import LEVELS, Obstacles
from joybridge.games.shooting_birds.sensing import front
from joybridge.simulator.compiled import compiled
from joybridge.simulator.randomness import Streams, integer, reserve, uniform

TICK = foes.TICK
EPISODE_TICKS = 2000
BIRDS = 10
MAGAZINE = 8
TOP_SPEED = 50.0  # of the crosshair, units/s

# The crosshair is a disc inside four walls. Skin and slop are contact tolerances of the original engine.
RADIUS, SKIN, SLOP, FRICTION = 1.28, 0.01, 0.005, 0.4
TOUCH = RADIUS + SKIN  # distance from center to wall at which the contact begins
WALL_X, WALL_Y = 19.0, 11.5
PUSH_PASSES, PUSH_SHARE, PUSH_MOST = 3, 0.2, 0.2  # the contact solver's corrections of the position per tick

SPAWN_LEFT, SPAWN_RIGHT, BIRD_LIMIT_X = -19.7, 19.6, 20.0
WAITING_X = 1000.0  # where birds wait that will enter later
ANY_LEVEL, GENERATED = -1, -2  # in place of a fixed level

HIT, MISS, DRY_SHOT, RELOAD, AIMED_HIT, AIMED_MISS = range(6)  # reward channels
SIZE_REWARD = np.array([0.25, 0.75, 2.0])  # large, medium, small
MISS_REWARD, DRY_SHOT_REWARD = -0.1, -1.0


class Rules(NamedTuple):
    """The quirks of the original."""

    hit_pays_replacement: bool  # the reward of a hit depends on the size of the bird that replaces the one hit
    whole_magazines: bool  # the ammo sensor is 1 for a full magazine, else 0
    dry_shots_are_aimed: bool  # the aiming channels also reward shots with an empty gun
    origin_x: float  # origin of the observed position; in the original it is not the arena's center


ORIGINAL = Rules(True, True, True, -1.1)
CORRECTED = Rules(False, False, False, 0.0)


class World(NamedTuple):
    """What all arenas of a session share."""

    rules: Rules
    obstacles: Obstacles
    flights: Array  # how birds enter the levels, records of dtype FLIGHT
    habit: int  # of new birds: see foes.py
    fixed_level: int  # ANY_LEVEL: a random one in each episode; GENERATED: each arena's row has its own
    camera: int  # what moves it: see camera.py

    @property
    def draws(self) -> int:
        """Return the most random numbers that one arena draws per call."""
        more = 0 if self.habit == foes.STRAIGHT else foes.BEGIN_DRAWS * (BIRDS + 1) + foes.STEER_DRAWS * BIRDS
        more += 2 * (BIRDS + 1) if self.fixed_level == GENERATED else 0
        return MAX_DRAWS + more + (0 if self.camera == camera.FIXED else 2 * BIRDS + 1)


BIRD = np.dtype(
    [
        ("x", "f8"),
        ("y", "f8"),
        ("z", "f8"),
        ("vx", "f8"),
        ("vy", "f8"),
        ("phase", "f8"),
        ("kind", "i8"),  # its size: 0 large, 1 medium, 2 small
        ("wait", "i8"),  # ticks until it enters; 0: it is there
        *foes.MEMORY,
    ]
)
ARENA = np.dtype(
    [
        ("x", "f8"), ("y", "f8"), ("vx", "f8"), ("vy", "f8"),  # the crosshair
        ("heading", "f8"),  # rad; only the locomotion "steer" turns it
        ("ammo", "i8"), ("level", "i8"), ("fixed_level", "i8"),  # level: its row in the tables of World
        ("number", "i8"),  # of the generated level
        ("camera", "f8"), ("scroll", "f8"), ("empty", "i8"),  # its middle, its device; ticks without birds in view
        ("shots", "i8"), ("hits", "i8"), ("reloads", "i8"),  # in this episode; shots without ammo are not counted
        ("tick", "i8"), ("clock", "i8"),  # ticks of this episode; ticks since the start, for the birds' flight
        ("birds", BIRD, (BIRDS,)),
        ("bird_speed", "f8"),  # a parameter: factor on the speed of new birds
        ("turn_rate", "f8"), ("reaction_radius", "f8"), ("reaction_delay", "f8"), ("blink_period", "f8"),  # parameters
        ("first_level", "f8"), ("level_count", "f8"),  # parameters
    ]
)  # fmt: skip

# The most that one arena of straight birds draws per call: ten new birds, one hit bird, a new episode, phases.
MAX_DRAWS = 5 * (BIRDS + 1) + 4 + BIRDS


def begin(arenas: "np.recarray[Any, Any]", streams: Streams, world: World) -> None:
    """Fill arenas, zeros but for the parameters, as at the start of the program: ten new birds, and a first episode.

    Generated levels need birds only when they have been made: see `populate`.
    """
    arenas.fixed_level = world.fixed_level
    reserve(streams, world.draws)
    if world.fixed_level != GENERATED:
        populate(arenas, streams, world)
    begin_episodes(arenas, streams)


@compiled
def populate(arenas, streams, world):
    """Put ten new birds into every arena."""
    for i in range(len(arenas)):
        for bird in arenas[i].birds:
            bird.phase = uniform(streams, i, -45.0, 45.0)  # once: a bird keeps its phase when it is replaced
            spawn(bird, streams, i, arenas[i], world)


@compiled
def begin_episodes(arenas, streams):
    """Reset crosshair, gun and level of every arena. Birds and clock are not reset."""
    for i in range(len(arenas)):
        begin_episode(arenas[i], streams, i)


@compiled
def begin_episode(arena, streams, i):
    """Reset crosshair, gun and level of arena i. The crosshair keeps its velocity until the first action."""
    arena.camera, arena.empty = 0.0, 0
    arena.x = uniform(streams, i, -11.1, 8.9)
    arena.y = uniform(streams, i, -10.0, 10.0)
    arena.ammo = 1 + integer(streams, i, MAGAZINE - 1)  # 1..7, so the magazine is never full
    if arena.fixed_level == GENERATED:
        arena.level, arena.number = i, draw_level(arena, streams, i)
    else:
        level = integer(streams, i, LEVELS)
        arena.level = level if arena.fixed_level == ANY_LEVEL else arena.fixed_level
    arena.shots = arena.hits = arena.reloads = arena.tick = 0


@compiled
def _enter(arena, streams, i, world, from_left):
    """Return where a bird enters: at an edge of the field, or with a camera anywhere outside the screen."""
    if world.camera != camera.FIXED:
        return camera.enter(arena, uniform(streams, i, 0.0, 1.0))
    return SPAWN_LEFT if from_left else SPAWN_RIGHT


@compiled
def spawn(bird, streams, i, arena, world):
    """Place a bird of arena i at the left or right edge, with a new height, size, depth and speed."""
    flight = world.flights[arena.level]
    from_left = uniform(streams, i, 0.0, 1.0) < 0.5
    bird.x = _enter(arena, streams, i, world, from_left)
    line = flight.lines[integer(streams, i, flight.line_count) if flight.line_count > 1 else 0]
    bird.y = uniform(streams, i, line[0], line[1])
    size = uniform(streams, i, 0.0, 1.0)
    bird.kind = 0 if size < flight.large else (1 if size < flight.medium else 2)
    bird.z = bird.kind - uniform(streams, i, 0.1, 0.2)
    speed = uniform(streams, i, flight.slowest, flight.fastest) * arena.bird_speed
    bird.vx = speed if from_left else -speed
    bird.vy = 0.0
    bird.wait = 0
    if flight.pause > 0.0:
        bird.wait = int(uniform(streams, i, 0.0, 2.0 * flight.pause) / TICK)
        bird.x = bird.x if bird.wait == 0 else WAITING_X
    foes.begin(bird, streams, i, world.habit)


@compiled
def tick(arenas, streams, world, velocity, shoot, reload, rewards):
    """Advance every arena by one tick under its action and add to `rewards` [arenas, channels].

    velocity: commanded velocity [arenas, 2]. shoot, reload: 0 or 1 [arenas]. Episodes that have reached their length
    are not reset here: the caller observes them first, then begins new ones.
    """
    for i in range(len(arenas)):
        arena = arenas[i]
        arena.vx, arena.vy = velocity[i, 0], velocity[i, 1]
        if shoot[i]:
            _shoot(arena, streams, i, world, rewards[i])
        if reload[i]:
            rewards[i, RELOAD] -= arena.ammo / MAGAZINE
            arena.ammo = MAGAZINE
            arena.reloads += 1
        _fly(arena, streams, i, world)
        _move_crosshair(arena)
        if world.camera != camera.FIXED:
            camera.scroll(arena, world.camera)
        for bird in arena.birds:
            if bird.wait == 0:
                bird.x += bird.vx * TICK
                bird.y += bird.vy * TICK
        if world.camera != camera.FIXED:
            arena.empty += camera.count_birds(arena)[1] == 0
        arena.tick += 1
        arena.clock += 1


@compiled
def _shoot(arena, streams, i, world, rewards):
    """Shoot at what is in front under the crosshair, which is what the agent observed for this decision."""
    target = front(arena, world.obstacles)
    loaded = arena.ammo > 0
    if loaded or world.rules.dry_shots_are_aimed:
        if target >= 0:
            rewards[AIMED_HIT] += SIZE_REWARD[arena.birds[target].kind]
        else:
            rewards[AIMED_MISS] += MISS_REWARD
    if not loaded:
        rewards[DRY_SHOT] += DRY_SHOT_REWARD
        return
    arena.ammo -= 1
    arena.shots += 1
    if target < 0:
        rewards[MISS] += MISS_REWARD
        return
    arena.hits += 1
    bird = arena.birds[target]
    true_size = bird.kind
    spawn(bird, streams, i, arena, world)
    rewards[HIT] += SIZE_REWARD[bird.kind if world.rules.hit_pays_replacement else true_size]


@compiled
def _fly(arena, streams, i, world):
    """Set the velocity of every bird, let those enter whose time it is, and replace those that have left."""
    beyond = 0.0 if world.camera == camera.FIXED else camera.MAX_CAMERA_X
    foes.steer(arena, streams, i, beyond)
    for bird in arena.birds:
        if bird.wait > 0:
            bird.wait -= 1
            if bird.wait == 0:
                bird.x = _enter(arena, streams, i, world, bird.vx > 0.0)
        elif abs(bird.x) > BIRD_LIMIT_X + beyond:
            spawn(bird, streams, i, arena, world)


@compiled
def _move_crosshair(arena):
    """Move the crosshair by one tick inside the walls, as the original's contact solver does.

    A wall acts only if it was touched at the start of the tick: a fast crosshair first sinks into it and is then
    pushed out over several ticks. x and y are independent except for friction.
    """
    place = arena.x - arena.camera
    touch_x, touch_y = _gap(place, WALL_X) <= TOUCH, _gap(arena.y, WALL_Y) <= TOUCH
    into_x = arena.vx if touch_x and (arena.vx > 0.0) == (place > 0.0) else 0.0
    into_y = arena.vy if touch_y and (arena.vy > 0.0) == (arena.y > 0.0) else 0.0
    arena.vx -= into_x
    arena.vy -= into_y
    arena.vx -= min(max(arena.vx, -FRICTION * abs(into_y)), FRICTION * abs(into_y))
    arena.vy -= min(max(arena.vy, -FRICTION * abs(into_x)), FRICTION * abs(into_x))
    arena.x += arena.vx * TICK
    arena.y += arena.vy * TICK
    for _ in range(PUSH_PASSES):
        if touch_x:
            arena.x -= _push(arena.x - arena.camera, WALL_X)
        if touch_y:
            arena.y -= _push(arena.y, WALL_Y)


@compiled
def _gap(position, wall):
    """Return the distance from the center to the nearer of the two walls at +wall and -wall."""
    return wall - abs(position)


@compiled
def _push(position, wall):
    """Return how far one correction moves the center back from the wall it has sunk into, with its sign."""
    depth = TOUCH - _gap(position, wall)
    push = min(max(PUSH_SHARE * (depth - SLOP), 0.0), PUSH_MOST)
    return push if position > 0.0 else -push
