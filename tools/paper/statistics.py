"""Rules that decide whether a claim holds: small functions of samples, for our runs and the original's alike."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from statistics import mean, stdev

from scipy.stats import f as f_distribution
from scipy.stats import t as t_distribution

HOLDS, FAILS, UNDECIDED, UNTESTED = "holds", "does not hold", "undecided", "not tested"
SIGNIFICANCE = 0.05  # of every test
EVEN = 10.0  # points of reward: scores are alike if they surely differ by no more


@dataclass(frozen=True)
class Sample:
    """What several runs of one experiment say at one length."""

    mean: float
    spread: float  # standard deviation of one run
    runs: int
    freedom: int  # degrees of freedom of the spread


def sample(values: Sequence[float]) -> Sample:
    """Return what runs say by themselves; a single one says nothing of its spread."""
    return Sample(mean(values), stdev(values) if len(values) > 1 else 0.0, len(values), len(values) - 1)


def pooled(ours: Sample, theirs: Sample) -> Sample:
    """Return our sample with the spread of both together: a few runs do not tell how much they scatter."""
    freedom = ours.freedom + theirs.freedom
    variance = (ours.freedom * ours.spread**2 + theirs.freedom * theirs.spread**2) / freedom
    return Sample(ours.mean, math.sqrt(variance), ours.runs, freedom)


@dataclass(frozen=True)
class Verdict:
    """Whether a claim holds, and the figures that show it."""

    word: str
    evidence: str
    where: str = ""  # the length of the runs that were compared, where it matters


Rule = Callable[[Sequence[Sample]], str]


def differ(ours: Sample, theirs: Sample) -> bool:
    """Return whether our mean differs significantly from theirs of the same experiment, by Student's t test."""
    both = pooled(ours, theirs)
    error = both.spread * math.sqrt(1 / ours.runs + 1 / theirs.runs)
    return abs(ours.mean - theirs.mean) > error * float(t_distribution.ppf(1 - SIGNIFICANCE / 2, both.freedom))


def beats(samples: Sequence[Sample]) -> str:
    """Decide whether the first is higher than each of the others, beyond the noise."""
    first, *others = samples
    gains = [(first.mean - other.mean, margin(first, other)) for other in others]
    if any(gain < -least for gain, least in gains):
        return FAILS
    return HOLDS if all(gain > least for gain, least in gains) else UNDECIDED


def trails(samples: Sequence[Sample]) -> str:
    """Decide whether the first is lower than each of the others, beyond the noise."""
    return beats([replace(each, mean=-each.mean) for each in samples])


def alike(samples: Sequence[Sample]) -> str:
    """Decide whether no two differ beyond the noise, and whether none can differ by more than EVEN."""
    pairs = [(abs(a.mean - b.mean), margin(a, b)) for i, a in enumerate(samples) for b in samples[:i]]
    if any(difference > least for difference, least in pairs):
        return FAILS
    return HOLDS if max(difference + least for difference, least in pairs) <= EVEN else UNDECIDED


def steadier(first: Sequence[Sample], second: Sequence[Sample]) -> str:
    """Decide by an F test whether runs of the first experiments scatter less than those of the second."""
    (calm, calm_freedom), (wild, wild_freedom) = _pooled_variance(first), _pooled_variance(second)
    chance = float(f_distribution.sf(wild / max(calm, 1e-9), wild_freedom, calm_freedom))
    if chance > 1 - SIGNIFICANCE:
        return FAILS
    return HOLDS if chance < SIGNIFICANCE else UNDECIDED


def margin(a: Sample, b: Sample) -> float:
    """Return the difference of two means from which on it is significant, by Welch's t test."""
    errors = [each.spread**2 / each.runs for each in (a, b)]
    if not sum(errors):
        return 0.0
    freedom = sum(errors) ** 2 / sum(
        error**2 / each.freedom for error, each in zip(errors, (a, b), strict=True) if error
    )
    return math.sqrt(sum(errors)) * float(t_distribution.ppf(1 - SIGNIFICANCE / 2, freedom))


def _pooled_variance(samples: Sequence[Sample]) -> tuple[float, int]:
    """Return the variance over runs, pooled over experiments, and its degrees of freedom."""
    freedom = sum(each.freedom for each in samples)
    return sum(each.spread**2 * each.freedom for each in samples) / freedom, freedom
