"""Hard Move (HyAR, Li et al. 2022): move a particle to a target with n actuators that are on or off, and one power.

The literature has a choice for each of the 2^n combinations, and a parameter for each, which is the power. Here the
power is one axis, because only the chosen one counts. With buttons, a policy decides on every actuator by itself.
"""

from collections.abc import Mapping
from functools import cache

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
from joybridge.simulator import ActArrays, Array, axis, behavior, branch, button, option
from joybridge.simulator.compiled import compiled
from joybridge.v1 import bridge_pb2 as pb

DECISIONS = 30  # per episode, at most


class HardMove(ParticleGame):
    """A particle that is moved by actuators around it."""

    name = "hard_move"
    description = "Move a particle to a target with actuators that are on or off, all with the same power."
    options = (
        option("actuators", ["4", "6", "8", "10"], description="that surround the particle, n"),
        option(
            "choice",
            ["buttons", "joint"],
            description="buttons: one for each actuator; joint: one branch of all 2^n combinations, as others have it",
        ),
    )

    @classmethod
    def describe(cls, options: Mapping[str, str]) -> pb.GameSpec:
        """Return the spec: the actuators and their power."""
        actuators = int(options["actuators"])
        if options["choice"] == "buttons":
            branches = [button(f"actuator_{i}", f"towards {360 * i / actuators:g}°") for i in range(actuators)]
        else:
            combinations = [f"{number:0{actuators}b}" for number in range(2**actuators)]
            branches = [branch("actuators", combinations, "which are on, beginning with that towards 0°")]
        mover = behavior(
            "mover",
            description="20 at the target; before, minus the square of the distance in every decision",
            sensors=SENSORS,
            axes=[axis("power", description="of all actuators that are on; negative: backwards")],
            branches=branches,
            channels=CHANNELS,
            metrics=METRICS,
        )
        return cls.record_spec(mover, max_episode_decisions=DECISIONS, picture=PICTURE)

    def __init__(
        self, options: Mapping[str, str], parameters: Mapping[str, float], arenas: int, first_arena: int, seed: int
    ) -> None:
        """Begin a first episode in every arena."""
        self.limit, actuators = DECISIONS, int(options["actuators"])
        self.motions = motions(actuators)
        # The number of a combination has the first actuator as its highest bit.
        self.places = 2 ** np.arange(actuators)[::-1] if options["choice"] == "buttons" else np.ones(1, np.int64)
        super().__init__(options, parameters, arenas, first_arena, seed)

    def decide(self, act: ActArrays, rewards: Array) -> None:
        """Push the particle."""
        force = FORCE * act.axes[:, :1].astype(np.float64) * self.motions[act.choices @ self.places]
        _decide(self.arenas, force, rewards)


@cache
def motions(actuators: int) -> Array:
    """Return the motion of each combination of actuators, float64 [2^actuators, 2]; the longest is 1 long."""
    angles = 2.0 * np.pi * np.arange(actuators) / actuators
    directions = np.round(np.stack([np.cos(angles), np.sin(angles)], axis=1), 3)  # as the original rounds them
    sums = np.zeros((2**actuators, 2))
    for bit, direction in enumerate(directions[::-1]):
        sums[(np.arange(2**actuators) >> bit) % 2 == 1] += direction
    return sums / np.sqrt((sums * sums).sum(axis=1)).max()


@compiled
def _decide(arenas, force, rewards):
    for i in range(len(arenas)):
        arena = arenas[i]
        square = drift(arena, force[i, 0], force[i, 1])
        rewards[i] = -square
        if square <= NEAR * NEAR:
            rewards[i], arena.outcome, arena.success = REACHED_REWARD - square, TERMINATED, True
        elif arena.decisions == DECISIONS:
            arena.outcome = TRUNCATED
