"""Catch Point (Fan et al. 2019, in the form of HyAR, Li et al. 2022): steer to a point and catch it in time.

The number of catches that are left and the time are not observed. Ten catches may miss; the decision after the eleventh
miss ends the episode. From far away, to waste them pays more than to wander: compare successes, not rewards.
"""

from collections.abc import Mapping

import numpy as np

from joybridge.games.hybrid_suite.particle import (
    FORCE,
    NEAR,
    PICTURE,
    REACHED_REWARD,
    SENSORS,
    ParticleGame,
    drift,
)
from joybridge.games.hybrid_suite.suite_game import CHANNELS, METRICS, TERMINATED, TRUNCATED
from joybridge.simulator import ActArrays, Array, axis, behavior, branch, option
from joybridge.simulator.compiled import compiled
from joybridge.simulator.trigonometry import cosine, sine
from joybridge.v1 import bridge_pb2 as pb

MOVE, CATCH = range(2)
MISSES = 10  # that an episode survives


class CatchPoint(ParticleGame):
    """A particle that is steered by its direction alone, and a catch."""

    name = "catch_point"
    description = (
        "Steer a particle with inertia to a point, and catch it there: a direction that counts for one choice."
    )
    options = (
        option(
            "decisions",
            ["25", "30"],
            description="per episode, at most; most of the literature has 25, with which 96.4 % of the points can be "
            "reached, and with 30 99.7 %",
        ),
    )

    @classmethod
    def describe(cls, options: Mapping[str, str]) -> pb.GameSpec:
        """Return the spec: a branch for the action and an axis for the direction."""
        catcher = behavior(
            "catcher",
            description="20 for the point, less the square of the distance in every decision",
            sensors=SENSORS,
            axes=[
                axis(
                    "direction", description="of the force, share of 180°, clockwise from +y", only_with=("act", "move")
                )
            ],
            branches=[branch("act", ["move", "catch"])],
            channels=CHANNELS,
            metrics=METRICS,
        )
        return cls.record_spec(catcher, max_episode_decisions=int(options["decisions"]), picture=PICTURE)

    def __init__(
        self, options: Mapping[str, str], parameters: Mapping[str, float], arenas: int, first_arena: int, seed: int
    ) -> None:
        """Begin a first episode in every arena."""
        self.limit = int(options["decisions"])
        super().__init__(options, parameters, arenas, first_arena, seed)

    def decide(self, act: ActArrays, rewards: Array) -> None:
        """Move with full force, or drift and catch."""
        _decide(self.arenas, self.limit, act.choices[:, 0].copy(), act.axes[:, 0].astype(np.float64), rewards)


@compiled
def _decide(arenas, limit, act, direction, rewards):
    for i in range(len(arenas)):
        arena, angle = arenas[i], np.pi * direction[i]
        force = FORCE if act[i] == MOVE else 0.0
        square = drift(arena, force * sine(angle), force * cosine(angle))
        if arena.misses > MISSES:
            rewards[i], arena.outcome = 0.0, TERMINATED
        elif act[i] == CATCH and square <= NEAR * NEAR:
            rewards[i], arena.outcome, arena.success = REACHED_REWARD - square, TERMINATED, True
        else:
            rewards[i] = -square
            arena.misses += act[i] == CATCH
            if arena.decisions == limit:
                arena.outcome = TRUNCATED
