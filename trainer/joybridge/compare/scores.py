"""What the runs of a comparison have reached: their metrics as curves, and one score per run."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from statistics import mean
from typing import NamedTuple

from joybridge.config.errors import CheckpointError, ConfigError
from joybridge.config.metrics import Row

FINAL = 0.1  # of the rows of metrics: their mean is the score of a run


class Point(NamedTuple):
    """A row of metrics: where the run was, and the value of the compared metric."""

    timesteps: int
    seconds: float  # of wall-clock time since the run began; not a number in files without them
    value: float


@dataclass(frozen=True)
class Run:
    """One run of a variant."""

    seed: int
    points: tuple[Point, ...]  # at least one

    @cached_property
    def score(self) -> float:
        """Return the mean value of the last tenth of the rows, at least one."""
        return mean(point.value for point in self.points[-math.ceil(FINAL * len(self.points)) :])

    @property
    def seconds(self) -> float:
        """Return the wall-clock time of the run in seconds."""
        return self.points[-1].seconds

    def first_at(self, score: float) -> Point | None:
        """Return the first row whose value is at least `score`; None if there is none."""
        return next((point for point in self.points if point.value >= score), None)


def score_at(run: Run, timesteps: int, interval: int, rows: int) -> float | None:
    """Return the mean value of the last rows until some timesteps, `rows` of them; None if there is none.

    interval: timesteps between two rows.
    """
    values = [point.value for point in run.points if point.timesteps // interval <= timesteps // interval]
    return mean(values[-rows:]) if values else None


def score_run(rows: Sequence[Row], source: str, seed: int, metric: str) -> Run:
    """Return a run from its rows of metrics. Raises CheckpointError and ConfigError, which name the source."""
    points = tuple(
        Point(int(row["timesteps"]), row.get("seconds", math.nan), row[metric]) for row in rows if metric in row
    )
    for point in points:
        if not math.isfinite(point.value):
            raise CheckpointError(
                f"{source}: {metric} is {point.value} after {point.timesteps:,} timesteps, expected a finite number; "
                "move it away"
            )
    if not points:
        known = sorted({name for row in rows for name in row} - {"timesteps", "seconds"})
        why = "no episode ended; lengthen the runs" if metric == "reward" else f"it has {', '.join(known) or 'no rows'}"
        raise ConfigError(f"{source} has no {metric}: {why}")
    return Run(seed, points)
