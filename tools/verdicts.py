"""Rules that decide whether a claim holds: small functions of samples, for our runs and the original's alike."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from scipy.stats import f as f_distribution

HOLDS, FAILS, UNDECIDED, UNTESTED = "holds", "does not hold", "undecided", "not tested"
NOISES = 2.0  # a difference counts from so many of its standard errors on
EVEN = 10.0  # points of reward; "no difference" can be said only where the noise is smaller
SIGNIFICANCE = 0.05  # of the F test


@dataclass(frozen=True)
class Sample:
    """What several runs of one experiment say at one length."""

    mean: float
    spread: float  # standard deviation of one run
    runs: int


@dataclass(frozen=True)
class Verdict:
    """Whether a claim holds, and the figures that show it."""

    word: str
    evidence: str
    where: str = ""  # the length of the runs that were compared, where it matters


Rule = Callable[[Sequence[Sample]], str]


def beats(samples: Sequence[Sample]) -> str:
    """Decide whether the first is higher than each of the others, beyond the noise."""
    first, *others = samples
    gains = [(first.mean - other.mean) / max(_noise(first, other), 1e-9) for other in others]
    if min(gains) < -NOISES:
        return FAILS
    return HOLDS if min(gains) > NOISES else UNDECIDED


def trails(samples: Sequence[Sample]) -> str:
    """Decide whether the first is lower than each of the others, beyond the noise."""
    return beats([Sample(-sample.mean, sample.spread, sample.runs) for sample in samples])


def alike(samples: Sequence[Sample]) -> str:
    """Decide whether no two differ beyond the noise, which must be small enough to tell."""
    pairs = [(abs(a.mean - b.mean), NOISES * _noise(a, b)) for i, a in enumerate(samples) for b in samples[:i]]
    if any(difference > noise for difference, noise in pairs):
        return FAILS
    return HOLDS if max(noise for _, noise in pairs) <= EVEN else UNDECIDED


def steadier(first: Sequence[Sample], second: Sequence[Sample]) -> str:
    """Decide by an F test whether runs of the first experiments scatter less than those of the second."""
    (calm, calm_freedom), (wild, wild_freedom) = _pooled_variance(first), _pooled_variance(second)
    chance = float(f_distribution.sf(wild / max(calm, 1e-9), wild_freedom, calm_freedom))
    if chance > 1 - SIGNIFICANCE:
        return FAILS
    return HOLDS if chance < SIGNIFICANCE else UNDECIDED


def _noise(a: Sample, b: Sample) -> float:
    """Return the standard error of the difference of two means."""
    return math.sqrt(a.spread**2 / a.runs + b.spread**2 / b.runs)


def _pooled_variance(samples: Sequence[Sample]) -> tuple[float, int]:
    """Return the variance over runs, pooled over experiments, and its degrees of freedom."""
    freedom = sum(sample.runs - 1 for sample in samples)
    return sum(sample.spread**2 * (sample.runs - 1) for sample in samples) / freedom, freedom
