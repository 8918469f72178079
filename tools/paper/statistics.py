"""The statistics of the report: samples of runs, their comparison at the 5 % level, and intervals."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from statistics import mean, stdev

import numpy as np
from scipy.stats import bootstrap, ttest_ind_from_stats
from scipy.stats import f as f_distribution
from scipy.stats import t as t_distribution

from joybridge.compare import estimators

HOLDS, FAILS, UNDECIDED, UNTESTED = "holds", "does not hold", "undecided", "not tested"
SIGNIFICANCE = 0.05  # of every test
EQUIVALENCE = 10.0  # points of reward: means are alike if the interval of their difference is within


@dataclass(frozen=True)
class Sample:
    """Mean and standard deviation of one figure over several runs."""

    mean: float
    std: float  # of one run
    runs: int
    freedom: int  # degrees of freedom of `std`


@dataclass(frozen=True)
class Verdict:
    """Whether a claim holds, and the figures behind it."""

    word: str
    evidence: str
    where: str = ""  # the number of timesteps at which runs were compared
    p: float | None = None  # of the runs if the claim were false, where a test has one
    runs: str = ""  # how many were compared, layout by layout
    effect: str = ""  # how large the difference is, with its 95 % interval


Estimate = tuple[float, float, float]  # a value and its 95 % interval
Rule = Callable[[Sequence[Sample], Sequence[Sample]], str]  # compares the first samples with the second


def sample(values: Sequence[float]) -> Sample:
    """Return the sample of some runs; a single run has no standard deviation, and 0 is given."""
    return Sample(mean(values), stdev(values) if len(values) > 1 else 0.0, len(values), len(values) - 1)


def pooled(ours: Sample, theirs: Sample) -> Sample:
    """Return our sample with the pooled standard deviation of both, because a few runs do not show it."""
    freedom = ours.freedom + theirs.freedom
    variance = (ours.freedom * ours.std**2 + theirs.freedom * theirs.std**2) / freedom
    return Sample(ours.mean, math.sqrt(variance), ours.runs, freedom)


def differ(ours: Sample, theirs: Sample) -> bool:
    """Return whether two means of the same experiment differ by Student's t test."""
    both = pooled(ours, theirs)
    error = both.std * math.sqrt(1 / ours.runs + 1 / theirs.runs)
    return abs(ours.mean - theirs.mean) > error * _critical_t(both.freedom)


def welch_p(a: Sample, b: Sample) -> float:
    """Return the p value of Welch's t test of two means."""
    result = ttest_ind_from_stats(a.mean, a.std, a.runs, b.mean, b.std, b.runs, equal_var=False)
    return float(result.pvalue)


def variance_p(a: Sample, b: Sample) -> float:
    """Return the two-sided p value of an F test of two variances."""
    ratio = a.std**2 / b.std**2
    tails = f_distribution.sf(ratio, a.freedom, b.freedom), f_distribution.cdf(ratio, a.freedom, b.freedom)
    return 2 * float(min(tails))


def margin(a: Sample, b: Sample) -> float:
    """Return the smallest significant difference of two means by Welch's t test."""
    error, freedom = _welch(a, b)
    return error * _critical_t(freedom) if error else 0.0


def above(first: Sequence[Sample], second: Sequence[Sample]) -> str:
    """Decide whether each of the first means is significantly above each of the second."""
    gains = [(a.mean - b.mean, margin(a, b)) for a in first for b in second]
    if any(gain < -least for gain, least in gains):
        return FAILS
    return HOLDS if all(gain > least for gain, least in gains) else UNDECIDED


def alike(first: Sequence[Sample], second: Sequence[Sample]) -> str:
    """Decide whether no two of all means differ significantly, and none can differ by more than EQUIVALENCE."""
    samples = [*first, *second]
    pairs = [(abs(a.mean - b.mean), margin(a, b)) for i, a in enumerate(samples) for b in samples[:i]]
    if any(difference > least for difference, least in pairs):
        return FAILS
    return HOLDS if all(difference + least <= EQUIVALENCE for difference, least in pairs) else UNDECIDED


def steadier(first: Sequence[Sample], second: Sequence[Sample]) -> str:
    """Decide by an F test whether the pooled variance over runs of the first samples is below that of the second."""
    chance = steadier_p(first, second)
    if chance > 1 - SIGNIFICANCE:
        return FAILS
    return HOLDS if chance < SIGNIFICANCE else UNDECIDED


def above_p(first: Sequence[Sample], second: Sequence[Sample]) -> float:
    """Return the p value of `above`: the largest of its t tests, two-sided, and 1 if one of the first is lower."""
    return max(2 * _exceeds_p(a.mean - b.mean, a, b) if a.mean > b.mean else 1.0 for a in first for b in second)


def alike_p(first: Sequence[Sample], second: Sequence[Sample]) -> float:
    """Return the p value of two one-sided tests (TOST) that no two means differ by EQUIVALENCE; the largest of all."""
    samples = [*first, *second]
    return max(_exceeds_p(EQUIVALENCE - abs(a.mean - b.mean), a, b) for i, a in enumerate(samples) for b in samples[:i])


def steadier_p(first: Sequence[Sample], second: Sequence[Sample]) -> float:
    """Return the one-sided p value of the F test of `steadier`."""
    (calm, calm_freedom), (wild, wild_freedom) = _variance(first), _variance(second)
    return float(f_distribution.sf(wild / max(calm, 1e-9), wild_freedom, calm_freedom))


def above_effect(first: Sequence[Sample], second: Sequence[Sample]) -> Estimate:
    """Return the difference of two means: of the pair whose p value `above_p` is."""
    pairs = [(a, b) for a in first for b in second]
    return _difference(*max(pairs, key=lambda pair: _exceeds_p(pair[0].mean - pair[1].mean, *pair)))


def alike_effect(first: Sequence[Sample], second: Sequence[Sample]) -> Estimate:
    """Return the difference of the two of all means whose interval reaches farthest from 0."""
    samples = [*first, *second]
    differences = [_difference(a, b) for i, a in enumerate(samples) for b in samples[:i]]
    return max(differences, key=lambda each: max(-each[1], each[2]))


def steadier_effect(first: Sequence[Sample], second: Sequence[Sample]) -> Estimate:
    """Return how many times the standard deviation over runs of the first samples that of the second is."""
    (calm, calm_freedom), (wild, wild_freedom) = _variance(first), _variance(second)
    ratio = wild / max(calm, 1e-9)
    ends = f_distribution.ppf([1 - SIGNIFICANCE / 2, SIGNIFICANCE / 2], wild_freedom, calm_freedom)
    low, high = (math.sqrt(ratio / end) for end in ends)
    return math.sqrt(ratio), low, high


def interval(values: Sequence[float]) -> tuple[float, float] | None:
    """Return the 95 % bootstrap confidence interval of the mean, or None for a single value."""
    if len(values) < 2:
        return None
    result = bootstrap((values,), np.mean, method="percentile", rng=np.random.default_rng(0))
    return float(result.confidence_interval.low), float(result.confidence_interval.high)


def interquartile_mean(values: Sequence[float]) -> float:
    """Return the mean without the lowest and the highest quarter of the values; up to three values all count."""
    return float(estimators.interquartile_mean(np.array(values)[:, None]))


def _welch(a: Sample, b: Sample) -> tuple[float, float]:
    """Return the standard error of the difference of two means, and its degrees of freedom. One value has no error."""
    errors = [(each.std**2 / each.runs, each.freedom) for each in (a, b) if each.std]
    variance = sum(error for error, _ in errors)
    if not variance:
        return 0.0, 1.0
    return math.sqrt(variance), variance**2 / sum(error**2 / freedom for error, freedom in errors)


def _difference(a: Sample, b: Sample) -> Estimate:
    """Return the difference of two means with Welch's interval."""
    middle, half = a.mean - b.mean, margin(a, b)
    return middle, middle - half, middle + half


def _exceeds_p(difference: float, a: Sample, b: Sample) -> float:
    """Return how probable such a difference of two means, or a larger one, is if there is none."""
    error, freedom = _welch(a, b)
    return float(t_distribution.sf(difference / error, freedom)) if error else float(difference <= 0)


def _critical_t(freedom: float) -> float:
    return float(t_distribution.ppf(1 - SIGNIFICANCE / 2, freedom))


def _variance(samples: Sequence[Sample]) -> tuple[float, int]:
    """Return the variance over runs, pooled over experiments, and its degrees of freedom."""
    freedom = sum(each.freedom for each in samples)
    return sum(each.std**2 * each.freedom for each in samples) / freedom, freedom
