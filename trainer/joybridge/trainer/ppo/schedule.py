"""The schedules of a run, linear as in the original (ML-Agents 0.7): learning rate, clip range, entropy."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Coefficients:
    """The scheduled values of one update."""

    learning_rate: float
    clip_range: float
    entropy_coef: float


def anneal(progress: float, learning_rate: float, clip_range: float, entropy_coef: float) -> Coefficients:
    """Return the coefficients after a fraction `progress` of the run: linear, to 1e-10, 0.1 and 1e-5.

    The ends are fixed, as in the original: a coefficient that begins below its end rises to it.
    """
    left = 1.0 - min(max(progress, 0.0), 1.0)

    def line(start: float, end: float) -> float:
        return end + (start - end) * left

    return Coefficients(line(learning_rate, 1e-10), line(clip_range, 0.1), line(entropy_coef, 1e-5))
