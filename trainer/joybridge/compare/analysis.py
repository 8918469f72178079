"""The statistics of a comparison, from the scores of its runs. The same scores give the same numbers."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, count
from math import comb
from statistics import mean, median, stdev

import numpy as np

from joybridge.compare.estimators import (
    Estimate,
    bootstrap,
    difference,
    estimate,
    holm,
    interquartile_mean,
    mann_whitney,
    performance_profile,
    probability_of_improvement,
)
from joybridge.compare.scores import Point, Run
from joybridge.contract.tensors import Array

SIGNIFICANCE = 0.05
THRESHOLDS = 101  # of a performance profile
MAX_CURVE_POINTS = 200  # points of a learning curve


@dataclass(frozen=True)
class Band:
    """A line with its 95 % confidence band."""

    x: list[float]
    value: list[float]
    low: list[float]
    high: list[float]


@dataclass(frozen=True)
class Result:
    """What the runs of one variant have reached."""

    label: str
    runs: tuple[Run, ...]  # at least one
    iqm: Estimate  # of the scores
    curve: Band  # IQM of the metric over timesteps
    profile: Band  # fraction of runs above a score

    @property
    def scores(self) -> list[float]:
        """Return the score of each run."""
        return [run.score for run in self.runs]

    @property
    def mean(self) -> float:
        """Return the mean of the scores."""
        return mean(self.scores)

    @property
    def std(self) -> float:
        """Return the standard deviation of the scores; that of a single run is not known and given as 0."""
        return stdev(self.scores) if len(self.runs) > 1 else 0.0

    @property
    def median(self) -> float:
        """Return the median of the scores."""
        return median(self.scores)

    def firsts(self, score: float) -> list[Point | None]:
        """Return the first row of each run that reaches a score; None for a run without one."""
        return [run.first_at(score) for run in self.runs]


@dataclass(frozen=True)
class Pair:
    """Two variants, compared. A bootstrap only knows the runs that it has: of one each it has no interval to give."""

    first: str
    second: str
    runs: int  # of both together
    difference: Estimate  # of the interquartile mean of the first from that of the second
    improvement: Estimate  # the probability that a run of the first is above one of the second
    p_value: float  # of the Mann-Whitney test
    corrected: float  # by Holm's method, for the number of pairs

    @property
    def overlap(self) -> bool:
        """Return whether neither all nor none of the runs of the first are better: else there is no interval."""
        return 0 < self.improvement.value < 1


@dataclass(frozen=True)
class Analysis:
    """Everything about a comparison that its page says."""

    metric: str
    score: float  # that the runs are timed to
    results: tuple[Result, ...]
    pairs: tuple[Pair, ...]  # that are tested: each once, in the order of the variants
    score_given: bool = True  # or it follows from the same runs

    @property
    def center(self) -> str:
        """Return what the interquartile mean is called."""
        return center(max(len(result.runs) for result in self.results))

    @property
    def smallest_p(self) -> float:
        """Return the smallest corrected p value that so few runs can have, of any pair."""
        sizes = {result.label: len(result.runs) for result in self.results}
        tested = [(sizes[pair.first], sizes[pair.second]) for pair in self.pairs]
        return min((_smallest_p(len(tested), n, m) for n, m in tested), default=0.0)


def center(runs: int) -> str:
    """Return what the interquartile mean of so many runs, at most, is called: of three or fewer it leaves out none."""
    return "IQM" if runs > 3 else "mean"


def least_seeds(pairs: int) -> int:
    """Return the least number of runs of each variant with which one of so many pairs can differ significantly."""
    return next(n for n in count(1) if _smallest_p(pairs, n, n) < SIGNIFICANCE)


def _smallest_p(pairs: int, n: int, m: int) -> float:
    """Return the corrected p value if all n runs of a variant are better than all m of another: the smallest one."""
    return pairs * 2 / comb(n + m, n)


def analyze(
    metric: str,
    runs: Mapping[str, Sequence[Run]],
    score: float | None = None,
    tested: Iterable[tuple[str, str]] | None = None,
) -> Analysis:
    """Return the statistics of all variants.

    runs: at least one of each variant, by its label. score: that runs are timed to; None: the lowest IQM that a variant
    has at the end of its curve, which is that of the final scores unless these were measured apart. tested: pairs of
    labels, of which those with runs are tested; None: all pairs.
    """
    scores = {label: np.array([[run.score] for run in each]) for label, each in runs.items()}
    everything = np.concatenate(list(scores.values()))
    margin = 0.05 * float(np.ptp(everything)) or 1.0
    thresholds = np.linspace(everything.min() - margin, everything.max() + margin, THRESHOLDS)
    results = tuple(
        Result(
            label,
            tuple(runs[label]),
            estimate(interquartile_mean, each),
            _curve(runs[label]),
            _band(thresholds, bootstrap(lambda drawn: performance_profile(drawn, thresholds), each)),
        )
        for label, each in scores.items()
    )
    wanted = combinations(scores, 2) if tested is None else tested
    labels = [(one, other) for one, other in wanted if one in scores and other in scores]
    p_values = [mann_whitney(scores[one][:, 0].tolist(), scores[other][:, 0].tolist()) for one, other in labels]
    pairs = tuple(
        Pair(
            one,
            other,
            len(runs[one]) + len(runs[other]),
            estimate(difference, scores[one], scores[other]),
            estimate(probability_of_improvement, scores[one], scores[other]),
            p_value,
            corrected,
        )
        for (one, other), p_value, corrected in zip(labels, p_values, holm(p_values), strict=True)
    )
    lowest = min(float(interquartile_mean(np.array([[run.trained] for run in each]))) for each in runs.values())
    return Analysis(metric, lowest if score is None else score, results, pairs, score is not None)


def _curve(runs: Sequence[Run]) -> Band:
    """Return the IQM over runs where all of them have a row, at most MAX_CURVE_POINTS times."""
    values = [{point.timesteps: point.value for point in run.points} for run in runs]
    marks = sorted(set.intersection(*(set(each) for each in values)))
    marks = marks[:: -(-len(marks) // MAX_CURVE_POINTS) or 1]
    table = np.array([[each[mark] for mark in marks] for each in values]).reshape(len(runs), len(marks))
    # Each mark is resampled by itself, as a task would be, and has an IQM of its own.
    return _band(np.array(marks), bootstrap(lambda drawn: interquartile_mean(drawn.swapaxes(-1, -2)[..., None]), table))


def _band(x: Array, estimates: tuple[Array, Array, Array]) -> Band:
    return Band(x.tolist(), *(each.tolist() for each in estimates))
