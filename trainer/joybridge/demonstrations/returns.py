"""What is earned after a demonstrated decision, from which a critic learns."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from torch import Tensor

from joybridge.contract.codec import StepArrays
from joybridge.contract.tensors import Array
from joybridge.demonstrations.recorded import RecordedEpisodes
from joybridge.ppo.loss import Actions


@dataclass
class Demonstrated(Actions):
    """Demonstrated actions, and their returns."""

    returns: Tensor  # [n], discounted, until the end of the episode; not scaled


def discounted_returns(
    stretch: RecordedEpisodes, behavior: int, rewards: Callable[[StepArrays], Array], gamma: float
) -> Array:
    """Return what each lane of a behavior earns after each decision until its episode ends, float32 [decisions, lanes].

    rewards: of a step, [lanes]. gamma: per decision of the lane; while it waits, nothing is discounted. After the end
    of a truncated episode nothing more is counted, since nobody knows what would have been earned.
    """
    returns = np.zeros((len(stretch.acts), len(stretch.steps[0][behavior].terminated)), np.float32)
    later = np.zeros(returns.shape[1])
    for number in reversed(range(len(returns))):
        after = stretch.steps[number + 1][behavior]
        later = np.where(after.ends, 0.0, later)
        later = rewards(after) + np.where(after.decides, gamma, 1.0) * later
        returns[number] = later
    return returns
