"""The scores of one arena: of the present episodes, and of those that have ended."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from joybridge.contract.codec import StepArrays, lane_count
from joybridge.policy.encoder import ObservationEncoder
from joybridge.v1 import bridge_pb2 as pb


class Seat(NamedTuple):
    """One agent of one behavior."""

    behavior: int
    agent: int


class Scores:
    """Adds up the rewards of all seats, with the weights of the game.

    now: of the present episodes, [agents] per behavior. ended: the episodes that ended with the last step, as the page
    shows them.
    """

    def __init__(self, spec: pb.GameSpec) -> None:
        """Begin at 0."""
        agents = [lane_count(behavior, 1) for behavior in spec.behaviors]
        self.seats = [Seat(index, agent) for index, count in enumerate(agents) for agent in range(count)]
        self.now = [np.zeros(count) for count in agents]
        self.ended: list[dict[str, Any]] = []
        self._lengths = [np.zeros(count, int) for count in agents]
        self._encoders = [ObservationEncoder(behavior.name, behavior, None, {}) for behavior in spec.behaviors]
        self._metrics = [[metric.name for metric in behavior.metrics] for behavior in spec.behaviors]

    def take(self, steps: Sequence[StepArrays]) -> None:
        """Take what followed a decision."""
        self.ended = []
        for index, step in enumerate(steps):
            self.now[index] += self._encoders[index].rewards(step)
            self._lengths[index] += 1
            for row, lane in enumerate(step.ended.tolist()):
                metrics = () if step.metrics is None else step.metrics[row].tolist()
                self.ended.append(
                    {
                        "seat": self.seats.index(Seat(index, lane)),
                        "terminated": bool(step.terminated[lane]),
                        "score": float(self.now[index][lane]),
                        "length": int(self._lengths[index][lane]),
                        "metrics": dict(zip(self._metrics[index], metrics, strict=False)),
                    }
                )
                self.now[index][lane] = self._lengths[index][lane] = 0
