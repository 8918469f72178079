"""The coefficients of an update. Learning rate, clip range and that of the entropy follow schedules."""

from dataclasses import dataclass

from joybridge.config.policy_config import PolicyConfig


@dataclass(frozen=True)
class Coefficients:
    """What the loss of one update is made of."""

    learning_rate: float
    clip_range: float
    entropy_coef: float
    vf_coef: float = 0.5
    clip_vloss: bool = True
    normalize_minibatch: bool = False  # the advantages of each minibatch, by its own mean and deviation
    sum_entropy: bool = False  # over the continuous actions, as always over branches; otherwise their mean


def anneal(progress: float, config: PolicyConfig) -> Coefficients:
    """Return the coefficients after a fraction `progress` of the run: linear ones fall to 1e-10, 0.1 and 1e-5.

    The ends are fixed, as in the original (ML-Agents 0.7): a coefficient that begins below its end rises to it.
    """
    left = 1.0 - min(max(progress, 0.0), 1.0)

    def line(schedule: str, start: float, end: float) -> float:
        return start if schedule == "constant" else end + (start - end) * left

    return Coefficients(
        line(config.learning_rate_schedule, config.learning_rate, 1e-10),
        line(config.clip_range_schedule, config.clip_range, 0.1),
        line(config.entropy_coef_schedule, config.entropy_coef, 1e-5),
        config.vf_coef,
        config.clip_vloss,
        config.normalize_advantage == "minibatch",
        config.entropy == "sum",
    )
