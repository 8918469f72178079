"""What the runs of a comparison have reached: their metrics as curves, and one score per run."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import fsum
from typing import NamedTuple

from joybridge.config.errors import CheckpointError, ConfigError
from joybridge.config.metrics import HELD_OUT, Row, is_of_episodes

EPISODES = f"{HELD_OUT}episodes"
PARTS = 10  # of the timesteps of a run: the mean over the episodes that end in the last one is its score
LEAST = 10  # episodes, over which a run reaches a score


class Point(NamedTuple):
    """A row of metrics: where the run was, and the value of the compared metric."""

    timesteps: int
    seconds: float  # of wall-clock time since the run began; not a number in files without them
    value: float
    episodes: int = 0  # of which it is the mean; 0: not known, not of episodes, or it was measured and each counts
    begin: int = 0  # timesteps, of the row


@dataclass(frozen=True)
class Run:
    """One run of a variant."""

    seed: int
    points: tuple[Point, ...]  # at least one
    end: int  # timesteps of its last row, whether that is a point or not
    measured: float | None = None  # by an evaluation at the end, of which the points are none
    episodes: int = 0  # of the last held-out measurement, if its values are compared

    @cached_property
    def score(self) -> float:
        """Return what was measured at the end, or the mean over the episodes that end in the last tenth of the run."""
        return self.trained if self.measured is None else self.measured

    @cached_property
    def trained(self) -> float:
        """Return the mean over the episodes of the training that end in the last tenth of the run."""
        return _mean(_last(self.points, self.end, self.end))

    @property
    def ended(self) -> int:
        """Return how many episodes of the training are behind the score; 0: not known."""
        return sum(point.episodes for point in _last(self.points, self.end, self.end))

    @property
    def early(self) -> int:
        """Return where the only row ends on which the score rests although it is before the last tenth; else 0."""
        last = _last(self.points, self.end, self.end)[-1]
        return 0 if self.measured is not None or last.timesteps > self.end - self.end / PARTS else last.timesteps

    @property
    def seconds(self) -> float:
        """Return the wall-clock time of the run in seconds."""
        return self.points[-1].seconds

    def first_at(self, score: float) -> Point | None:
        """Return the first row whose value is at least `score`; None if there is none.

        The value of a row of fewer than ten episodes is the mean over them and those of the rows before, up to ten: one
        lucky episode reaches nothing.
        """
        for at, point in enumerate(self.points):
            rows = _together(self.points[: at + 1])
            if rows and _mean(rows) >= score:
                return point
        return None


def score_at(run: Run, rung: int, end: int, interval: int) -> float | None:
    """Return what the score of a run was at a rung, an end of a row before its end; None if it had no value there.

    It is the mean over the episodes that end in as many timesteps before it as count for the score of a whole run.

    rung, end: timesteps, of the run the latter. interval: timesteps between two rows of metrics.
    """
    points = [point for point in run.points if point.timesteps // interval <= rung // interval]
    return _mean(_last(points, rung, end)) if points else None


def _together(points: Sequence[Point]) -> Sequence[Point]:
    """Return the last points that have ten episodes together; none where all have fewer.

    A point of unknown episodes stands alone.
    """
    episodes = 0
    for at in range(len(points) - 1, -1, -1):
        episodes += points[at].episodes or LEAST
        if episodes >= LEAST:
            return points[at:]
    return []


def _mean(points: Sequence[Point]) -> float:
    """Return the mean over the episodes of points."""
    return fsum(point.value * (point.episodes or 1) for point in points) / sum(point.episodes or 1 for point in points)


def _last(points: Sequence[Point], until: int, end: int) -> Sequence[Point]:
    """Return the points of which at least half lie in the last timesteps until some, a tenth of `end`; at least one."""
    begin = until - end / PARTS
    return [point for point in points if (point.begin + point.timesteps) / 2 >= begin] or points[-1:]


def score_run(rows: Sequence[Row], source: str, seed: int, metric: str) -> Run:
    """Return a run from its rows of metrics. Raises CheckpointError and ConfigError, which name the source.

    A metric that was only measured at the end, by `evaluate_during`, is the score, and the points are those of the same
    metric in training, if an episode ended there.
    """
    values = [row[metric] for row in rows if metric in row]
    held_out, in_training = metric.startswith(HELD_OUT), metric.removeprefix(HELD_OUT)
    episodes = next((int(row[EPISODES]) for row in reversed(rows) if EPISODES in row), 0) if held_out else 0
    if held_out and len(values) == 1 and metric in rows[-1] and any(in_training in row for row in rows):
        trained = score_run(rows, source, seed, in_training)
        found = _finite(values[0], f"{metric} is {values[0]} at the end", source)
        return replace(trained, measured=found, episodes=episodes)
    begins = [0, *(int(row["timesteps"]) for row in rows)]
    if begins != sorted(begins):
        raise CheckpointError(f"{source}: its rows are not in the order of their timesteps; move it away")
    points = tuple(
        Point(
            int(row["timesteps"]),
            row.get("seconds", math.nan),
            row[metric],
            int(row.get("episodes", 0)) if is_of_episodes(metric) else 0,
            begin,
        )
        for begin, row in zip(begins, rows, strict=False)
        if metric in row
    )
    for point in points:
        _finite(point.value, f"{metric} is {point.value} after {point.timesteps:,} timesteps", source)
    if not points:
        known = sorted({name for row in rows for name in row} - {"timesteps", "seconds"})
        lengthen = (
            "no episode ended; lengthen the runs, or let them end with an evaluation, evaluate_during.episodes=30"
        )
        why = lengthen if metric == "reward" else f"it has {', '.join(known) or 'no rows'}"
        raise ConfigError(f"{source} has no {metric}: {why}")
    return Run(seed, points, begins[-1], episodes=episodes)


def _finite(value: float, what: str, source: str) -> float:
    if not math.isfinite(value):
        raise CheckpointError(f"{source}: {what}, expected a finite number; move it away")
    return value
