"""Estimators for the scores of a few runs, after Agarwal et al., "Deep RL at the Edge of the Statistical Precipice".

Scores are arrays [runs, tasks]; a comparison on one game has one task. Point estimates and intervals are those of the
library rliable: with the same seed and number of resamples, they are the same numbers.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from scipy.stats import rankdata, trim_mean

from joybridge.contract.tensors import Array

CONFIDENCE = 0.95
RESAMPLES = 2000  # of the bootstrap, where nothing else is said


class Estimate(NamedTuple):
    """A value and its 95 % confidence interval."""

    value: float
    low: float
    high: float


def interquartile_mean(scores: Array) -> Array:
    """Return the mean without the lowest and the highest quarter of all scores of all tasks.

    scores: [..., runs, tasks]; the result has the shape [...]. Up to three scores all count.
    """
    together = scores.reshape(*scores.shape[:-2], scores.shape[-2] * scores.shape[-1])
    return np.asarray(trim_mean(together, 0.25, axis=-1))


def difference(first: Array, second: Array) -> Array:
    """Return how much the interquartile mean of the first scores is above that of the second.

    first, second: [..., runs, tasks]; the result has the shape [...].
    """
    return interquartile_mean(first) - interquartile_mean(second)


def probability_of_improvement(first: Array, second: Array) -> Array:
    """Return how likely a run of the first scores is above one of the second: the mean over tasks.

    first, second: [..., runs, tasks], of as many tasks; the result has the shape [...]. Equal scores count one half.
    """
    difference = first[..., :, None, :] - second[..., None, :, :]
    return np.asarray(np.mean((difference > 0) + 0.5 * (difference == 0), axis=(-3, -2, -1)))


def performance_profile(scores: Array, thresholds: Array) -> Array:
    """Return the fraction of all scores above each threshold.

    scores: [..., runs, tasks]; the result has the shape [..., thresholds].
    """
    return np.asarray(np.mean(scores[..., None] > thresholds, axis=(-3, -2)))


def bootstrap(
    estimator: Callable[..., Array], *scores: Array, seed: int = 0, resamples: int = RESAMPLES
) -> tuple[Array, Array, Array]:
    """Return an estimate for some scores, and the bounds of its 95 % confidence interval.

    The interval is that of the percentiles of a stratified bootstrap: runs are drawn with replacement, within each
    task and each of the given scores. estimator: one of the functions above, with an array [..., runs, tasks] for each
    of `scores`.
    """
    random = np.random.RandomState(seed)  # the generator of rliable
    drawn: list[list[Array]] = [[] for _ in scores]
    for _ in range(resamples):
        for rows, each in zip(drawn, scores, strict=True):
            rows.append(random.randint(0, len(each), each.shape))
    resampled = [
        np.take_along_axis(each[None], np.stack(rows), axis=1) for rows, each in zip(drawn, scores, strict=True)
    ]
    tail = 100 * (1 - CONFIDENCE) / 2
    low, high = np.percentile(estimator(*resampled), [tail, 100 - tail], axis=0)
    return estimator(*scores), low, high


def estimate(estimator: Callable[..., Array], *scores: Array, seed: int = 0, resamples: int = RESAMPLES) -> Estimate:
    """Return what `bootstrap` does for an estimator whose result is one number."""
    return Estimate(*map(float, bootstrap(estimator, *scores, seed=seed, resamples=resamples)))


def mann_whitney(first: Sequence[float], second: Sequence[float]) -> float:
    """Return the two-sided p value of the Mann-Whitney test that two samples have the same distribution.

    It is exact, also with equal values, which share the mean of their ranks: of all ways to choose as many of the
    values as the first sample has, it counts those whose sum of ranks is as far out.
    """
    ranks = (2 * rankdata([*first, *second])).astype(int)  # twice, so that means of ranks are whole numbers
    ways = np.zeros((len(first) + 1, ranks.sum() + 1))  # [values that are chosen, sum of their ranks]
    ways[0, 0] = 1
    for rank in ranks:
        ways[1:, rank:] += ways[:-1, : ways.shape[1] - rank].copy()
    shares, found = ways[-1] / ways[-1].sum(), ranks[: len(first)].sum()
    return min(1.0, 2 * float(min(shares[: found + 1].sum(), shares[found:].sum())))


def holm(p_values: Sequence[float]) -> list[float]:
    """Return p values corrected for their number by Holm's method, in the same order."""
    corrected, largest = [0.0] * len(p_values), 0.0
    for rank, index in enumerate(np.argsort(p_values, kind="stable")):
        largest = max(largest, min(1.0, p_values[index] * (len(p_values) - rank)))
        corrected[index] = largest
    return corrected
