"""Statistics of a player as metrics of episodes.

A statistic belongs to no episode. Where a message has as many values of one as episodes end in it, each episode has its
own value, in their order; otherwise all of them have the mean (or what the statistic asks for) of the values that came
since the last end of an episode, or the last such number if none came.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from joybridge.contract.tensors import Array
from joybridge.mlagents.side_channels import AVERAGE, MOST_RECENT, SUM


class Metrics:
    """The metrics of one behavior of one player."""

    def __init__(self, keys: Sequence[str]) -> None:
        """keys: the names of the statistics, in the order of the metrics."""
        self._before: dict[str, list[float]] = {key: [] for key in keys}  # since the last end of an episode
        self._now: dict[str, tuple[list[float], int]] = {key: ([], AVERAGE) for key in keys}  # of this message
        self._last = dict.fromkeys(keys, 0.0)

    def add(self, statistics: Mapping[str, tuple[list[float], int]]) -> None:
        """Take the statistics of a message: values and what is asked for, by name."""
        for key, (values, kind) in self._now.items():
            self._before[key] += values
            self._now[key] = statistics.get(key, ([], kind))

    def take(self, ended: int) -> Array:
        """Return the metrics of the episodes that end in the message, float32 [ended, metrics]."""
        columns = [self._column(key, ended) for key in self._last]
        return np.array(columns, np.float32).reshape(len(columns), ended).T

    def _column(self, key: str, ended: int) -> list[float]:
        now, kind = self._now[key]
        values, self._before[key], self._now[key] = self._before[key] + now, [], ([], kind)
        if values:
            summary = {MOST_RECENT: values[-1], SUM: sum(values)}
            self._last[key] = summary.get(kind, sum(values) / len(values))
        return now if len(now) == ended else [self._last[key]] * ended
