"""`ParticleGame`: what Catch Point and Hard Move share: a particle with inertia that has to come near a target.

The rules are those of the program of HyAR (Li et al. 2022). The plane has no bounds.
"""

from typing import ClassVar

import numpy as np

from joybridge.games.hybrid_suite.suite_game import COMMON, SuiteGame, distance_to_target
from joybridge.simulator import Array, check_range, sensor
from joybridge.simulator.compiled import compiled
from joybridge.simulator.randomness import Streams, reserve, uniform
from joybridge.v1 import bridge_pb2 as pb

KEPT, STEP = 0.75, 0.1  # of the velocity; s per decision
FORCE = 2.0  # at full power
NEAR = 0.2  # of the target, units
REACHED_REWARD = 20.0
MAX_DISTANCE = 10.0  # units: what a particle can reach in an episode, generously
PICTURE = (400, 400)  # width, height

SENSORS = [
    sensor("velocity", [2], -0.8, 0.8, "of the particle", elements=["x", "y"]),
    sensor("target", [2], description="the target's place relative to the particle", elements=["x", "y"]),
]

ARENA = np.dtype(
    [
        *COMMON,
        ("x", "f8"),
        ("y", "f8"),
        ("vx", "f8"),
        ("vy", "f8"),  # of the particle
        ("target_x", "f8"),
        ("target_y", "f8"),
        ("misses", "i8"),  # of this episode; only Catch Point has them
    ]
)


class ParticleGame(SuiteGame):
    """Many arenas with a particle and a target each."""

    arena_dtype: ClassVar[np.dtype[np.void]] = ARENA
    sensors: ClassVar[list[pb.Sensor]] = SENSORS
    limit: int  # decisions per episode, at most

    def begin_where(self, which: Array) -> None:
        """Put particle and target at random places."""
        reserve(self.streams, 4)
        _begin_episodes(self.arenas, self.streams, which)

    def distance(self) -> Array:
        """Return how far every particle is from its target."""
        return distance_to_target(self.fields)

    def write_sensors(self, *values: Array) -> None:
        """Write the values of every sensor."""
        velocity, target = values
        fields = self.fields
        velocity[:, 0], velocity[:, 1] = fields["vx"], fields["vy"]
        target[:, 0], target[:, 1] = fields["target_x"] - fields["x"], fields["target_y"] - fields["y"]

    def draw_record(self, arena: np.record) -> Array:
        """Return a picture of the record of an arena, uint8 [height, width, 3]."""
        from joybridge.games.hybrid_suite.drawing import (
            draw_particle,
        )  # imported here because only pictures need pygame

        return draw_particle(arena, NEAR, *PICTURE)

    def check_arenas(self, arenas: Array) -> None:
        """Raise ValueError for arenas in a state that cannot occur."""
        super().check_arenas(arenas)
        check_range("decisions", arenas["decisions"], 0, self.limit - 1)
        for field in ("x", "y"):
            check_range(field, arenas[field], -MAX_DISTANCE, MAX_DISTANCE)
            check_range(f"target_{field}", arenas[f"target_{field}"], -1.0, 1.0)
            check_range(f"v{field}", arenas[f"v{field}"], -1.0, 1.0)
        check_range("misses", arenas["misses"], 0, self.limit)


@compiled
def _begin_episodes(arenas: Array, streams: Streams, which: Array) -> None:
    for i in range(len(arenas)):
        if which[i]:
            arena = arenas[i]
            arena.x, arena.y = uniform(streams, i, -1.0, 1.0), uniform(streams, i, -1.0, 1.0)
            arena.target_x, arena.target_y = uniform(streams, i, -1.0, 1.0), uniform(streams, i, -1.0, 1.0)
            arena.vx = arena.vy = 0.0
            arena.misses = 0


@compiled
def drift(arena, force_x, force_y):
    """Move the particle by one decision; return the square of its distance to the target."""
    arena.vx = arena.vx * KEPT + force_x * STEP
    arena.vy = arena.vy * KEPT + force_y * STEP
    arena.x += arena.vx * STEP
    arena.y += arena.vy * STEP
    arena.decisions += 1
    return (arena.x - arena.target_x) ** 2 + (arena.y - arena.target_y) ** 2
