"""`SuiteGame`: what the tasks of the suite share: one agent per arena, one reward, and how episodes end.

Every task is rebuilt from its published rules. Where a published program differs from what its paper says, the task
does what the program does, because all published figures are about that.
"""

from abc import abstractmethod
from typing import ClassVar

import numpy as np

from joybridge.games.record_game import RecordGame
from joybridge.simulator import ActArrays, Array, StepArrays, channel, check_range, metric, quiet_step
from joybridge.v1 import bridge_pb2 as pb

GOING, TERMINATED, TRUNCATED = range(3)  # outcomes of a decision

# What every record of an arena begins with.
COMMON = [("decisions", "i8"), ("outcome", "i8"), ("success", "?")]

CHANNELS = [channel("reward", description="that of the original")]
METRICS = [
    metric("success", "1 if the episode reached its aim, else 0; the mean is the success rate of the literature"),
    metric("distance", "to the aim at the end, in the units of the task"),
]


class SuiteGame(RecordGame):
    """Many arenas of one task. Their records begin with the fields of `COMMON`."""

    version = "1"
    channels: ClassVar[list[pb.RewardChannel]] = CHANNELS
    parameters: ClassVar[list[pb.Parameter]] = []
    sensors: ClassVar[list[pb.Sensor]]

    @abstractmethod
    def decide(self, act: ActArrays, rewards: Array) -> None:
        """Advance every arena by one decision: write its reward, float64 [arenas], and its outcome."""

    def by_channel(self, rewards: Array) -> Array:
        """Return the rewards of a decision by channel, float32 [arenas, channels]; their sum is the task's."""
        return rewards.astype(np.float32)[:, None]

    @abstractmethod
    def distance(self) -> Array:
        """Return how far every arena is from its aim, float64 [arenas]."""

    @abstractmethod
    def begin_where(self, which: Array) -> None:
        """Begin a new episode in the arenas of `which`, bool [arenas]; `decisions` and `outcome` are 0 already."""

    @abstractmethod
    def write_sensors(self, *values: Array) -> None:
        """Write the values of every sensor in `sensors`, float32 [arenas, *shape]."""

    def begin(self) -> None:
        """Begin a first episode in every arena."""
        self.begin_episodes()

    def begin_episodes(self) -> None:
        """Begin a new episode in every arena."""
        self._begin(np.ones(len(self.arenas), bool))

    def _begin(self, which: Array) -> None:
        for name, _ in COMMON:
            self.fields[name][which] = 0
        self.begin_where(which)

    def observe(self) -> list[StepArrays]:
        """Return the current observations, with zero rewards and no episode ends."""
        return [quiet_step(self.observations(), len(self.channels))]

    def observations(self) -> list[Array]:
        """Return the current observations, float32 [arenas, *shape] per sensor."""
        values = [np.empty((len(self.arenas), *sensor.shape), np.float32) for sensor in self.sensors]
        self.write_sensors(*values)
        return values

    def step(self, acts: list[ActArrays]) -> list[StepArrays]:
        """Advance every arena by one decision; where an episode ends, another begins."""
        (act,) = acts
        rewards = np.zeros(len(self.arenas))
        self.decide(act, rewards)
        observations, outcome = self.observations(), self.fields["outcome"]
        step = StepArrays(observations, self.by_channel(rewards), outcome == TERMINATED, outcome == TRUNCATED)
        ends = outcome != GOING
        if ends.any():
            step.ended = np.flatnonzero(ends).astype(np.int32)
            step.final_observations = [sensor[ends] for sensor in observations]
            metrics = np.stack([self.fields["success"], self.distance()], axis=1)
            step.metrics = metrics[ends].astype(np.float32)
            step.parameters = self.played_parameters(step.ended)
            self.draw_parameters(step.ended)
            self._begin(ends)
            step.observations = self.observations()
        return [step]

    def check_arenas(self, arenas: Array) -> None:
        """Raise ValueError for arenas in a state that cannot occur. The tasks check their own fields."""
        check_range("outcome", arenas["outcome"], GOING, GOING)
        check_range("success", arenas["success"].view(np.uint8), 0, 0)


def distance_to_target(arenas: Array) -> Array:
    """Return the distance from (x, y) to the target in records of arenas that have one, float64 [arenas]."""
    dx, dy = arenas["x"] - arenas["target_x"], arenas["y"] - arenas["target_y"]
    return np.sqrt(dx * dx + dy * dy)
