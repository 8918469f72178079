"""Moving and Sliding (Fan et al. 2019, in the form of the program gym-hybrid): accelerate, turn and brake to a target.

In Sliding, the agent has inertia: it keeps its course, and a turn changes only where it accelerates to. An episode that
ends without success costs 1, also if it ran out of time: to leave the field at once costs less than to be late.
"""

import math
from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from joybridge.games.hybrid_suite.suite_game import CHANNELS, COMMON, METRICS, TERMINATED, SuiteGame, distance_to_target
from joybridge.simulator import ActArrays, Array, axis, behavior, branch, check_range, sensor
from joybridge.simulator.compiled import compiled
from joybridge.simulator.randomness import Streams, reserve, uniform
from joybridge.simulator.trigonometry import arctangent, cosine, sine
from joybridge.v1 import bridge_pb2 as pb

ACCELERATE, TURN, BRAKE = range(3)
DECISIONS = 200  # the next one ends an episode as a failure
ACCELERATION, HALF_TURN, BRAKING, TICK = 0.5, math.pi / 2, 0.1, 0.005
FULL_TURN = 2.0 * math.pi
TARGET_PLACES, TARGET_RADIUS = 0.9, 0.1  # targets are in ± this square
COST, SUCCESS_REWARD, FAILURE_REWARD = 0.001, 1.0, -1.0
PICTURE = (400, 400)  # width, height

SENSORS = [
    sensor("agent", [5], description="place, speed and heading", elements=["x", "y", "speed", "cosine", "sine"]),
    sensor("target", [2], -TARGET_PLACES, TARGET_PLACES, "its place", elements=["x", "y"]),
    sensor("distance", [2], 0.0, 3.0, "to the target, and whether it is inside", elements=["distance", "inside"]),
    sensor("time", [1], 0.0, 1.005, "share of the episode that is over"),
]

ARENA = np.dtype(
    [
        *COMMON,
        ("x", "f8"),
        ("y", "f8"),
        ("heading", "f8"),
        ("speed", "f8"),
        ("course", "f8"),  # of the agent; angles in rad
        ("target_x", "f8"),
        ("target_y", "f8"),
    ]
)


class Moving(SuiteGame):
    """An agent that goes where it looks."""

    name = "moving"
    description = "Accelerate, turn and brake to a target and stop there: two of the three actions have a strength."
    arena_dtype = ARENA
    sensors = SENSORS
    inertia: ClassVar[bool] = False

    @classmethod
    def describe(cls, options: Mapping[str, str]) -> pb.GameSpec:
        """Return the spec: a branch for the action and axes for the strength of two."""
        driver = behavior(
            "driver",
            description="how much nearer a decision brings it, less 0.001; 1 for a stop at the target, -1 for failure",
            sensors=SENSORS,
            axes=[
                axis("accelerate", 0.0, 1.0, "share of 0.5", only_with=("act", "accelerate")),
                axis("turn", description="share of 90°", only_with=("act", "turn")),
            ],
            branches=[branch("act", ["accelerate", "turn", "brake"])],
            channels=CHANNELS,
            metrics=METRICS,
        )
        return cls.record_spec(driver, picture=PICTURE)

    def begin_where(self, which: Array) -> None:
        """Put agent and target at random places."""
        reserve(self.streams, 5)
        _begin_episodes(self.arenas, self.streams, which)

    def decide(self, act: ActArrays, rewards: Array) -> None:
        """Accelerate, turn or brake, and move."""
        choice = act.choices[:, 0].copy()
        _decide(self.arenas, self.inertia, choice, act.axes.astype(np.float64), rewards)

    def distance(self) -> Array:
        """Return how far every agent is from its target."""
        return distance_to_target(self.fields)

    def write_sensors(self, *values: Array) -> None:
        """Write the values of every sensor."""
        _observe(self.arenas, *values)

    def draw_record(self, arena: np.record) -> Array:
        """Return a picture of the record of an arena, uint8 [height, width, 3]."""
        from joybridge.games.hybrid_suite.drawing import draw_moving  # imported here because only pictures need pygame

        return draw_moving(arena, TARGET_RADIUS, self.inertia, *PICTURE)

    def check_arenas(self, arenas: Array) -> None:
        """Raise ValueError for arenas in a state that cannot occur."""
        super().check_arenas(arenas)
        check_range("decisions", arenas["decisions"], 0, DECISIONS)
        for field in ("x", "y", "target_x", "target_y"):
            check_range(field, arenas[field], -1.0, 1.0)
        check_range("heading", arenas["heading"], 0.0, FULL_TURN)
        check_range("course", arenas["course"], -FULL_TURN, 2.0 * FULL_TURN)
        check_range("speed", arenas["speed"], 0.0, ACCELERATION * DECISIONS)


class Sliding(Moving):
    """An agent that slides on."""

    name = "sliding"
    description = "Moving with inertia: a turn does not change the course, only where the agent accelerates to."
    inertia = True


@compiled
def _begin_episodes(arenas: Array, streams: Streams, which: Array) -> None:
    for i in range(len(arenas)):
        if which[i]:
            arena = arenas[i]
            arena.x, arena.y = uniform(streams, i, -1.0, 1.0), uniform(streams, i, -1.0, 1.0)
            arena.heading = arena.course = uniform(streams, i, 0.0, FULL_TURN)
            arena.speed = 0.0
            arena.target_x = uniform(streams, i, -TARGET_PLACES, TARGET_PLACES)
            arena.target_y = uniform(streams, i, -TARGET_PLACES, TARGET_PLACES)


@compiled
def _decide(arenas, inertia, choice, axes, rewards):
    for i in range(len(arenas)):
        arena = arenas[i]
        before = _distance(arena)
        if choice[i] == ACCELERATE:
            _accelerate(arena, ACCELERATION * axes[i, 0])
        elif choice[i] == TURN:
            arena.heading = (arena.heading + HALF_TURN * axes[i, 1]) % FULL_TURN
        else:
            arena.speed = 0.0 if arena.speed < BRAKING else arena.speed - BRAKING
        if not inertia or arena.speed == 0.0:
            arena.course = arena.heading
        arena.x += TICK * arena.speed * cosine(arena.course)
        arena.y += TICK * arena.speed * sine(arena.course)
        arena.decisions += 1
        after = _distance(arena)
        rewards[i] = before - after - COST
        if after < TARGET_RADIUS and arena.speed == 0.0:
            rewards[i] += SUCCESS_REWARD
            arena.outcome, arena.success = TERMINATED, True
        elif abs(arena.x) > 1.0 or abs(arena.y) > 1.0 or arena.decisions > DECISIONS:
            rewards[i], arena.outcome = FAILURE_REWARD, TERMINATED


@compiled
def _accelerate(arena, push):
    """Add a push along the heading to the velocity, whose direction is the course."""
    apart = arena.course - arena.heading
    along, across = push + arena.speed * cosine(apart), arena.speed * sine(apart)
    arena.speed = math.sqrt(along * along + across * across)
    arena.course = arena.heading + arctangent(across, along)


@compiled
def _distance(arena):
    return math.sqrt((arena.x - arena.target_x) ** 2 + (arena.y - arena.target_y) ** 2)


@compiled
def _observe(arenas, agent, target, distance, time):
    """Write the sensors of every arena."""
    for i in range(len(arenas)):
        arena = arenas[i]
        agent[i, 0], agent[i, 1], agent[i, 2] = arena.x, arena.y, arena.speed
        agent[i, 3], agent[i, 4] = cosine(arena.heading), sine(arena.heading)
        target[i, 0], target[i, 1] = arena.target_x, arena.target_y
        apart = _distance(arena)
        distance[i, 0], distance[i, 1] = apart, 1.0 if apart <= TARGET_RADIUS else 0.0
        time[i, 0] = arena.decisions / DECISIONS
