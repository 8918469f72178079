"""Generalized state-dependent exploration (Raffin, Kober and Stulp 2021), gSDE, as in Stable-Baselines3."""

import torch
from torch import Tensor

from joybridge.ppo.continuous.gaussian import Gaussian

LEAST_VARIANCE = 1e-6  # where all features are 0


class GSDE:
    """The mean plus a linear function of the features, whose coefficients are random and kept for some decisions.

    So the noise of one decision is a Gaussian whose variance is the sum of squared features, each times a variance that
    is learned, and in similar situations it stays similar. Gradients of the variance end at the features.
    """

    outputs = 1

    def __init__(self, hold: int, features: int) -> None:
        """Keep the coefficients for `hold` decisions. features: of the last hidden layer."""
        self.hold = hold
        self.parameters = self.features = features  # parameters: the log-deviation of each coefficient
        self._inner = Gaussian()

    def sample(self, outputs: Tensor, parameters: Tensor, noise: Tensor) -> Tensor:
        """Return mean + features x coefficients. noise [features, n]."""
        return outputs[0] + _sum(outputs[1:] * torch.exp(parameters)[:, None] * noise)

    def log_prob(self, outputs: Tensor, parameters: Tensor, samples: Tensor) -> Tensor:
        """Return the log-density of each sample."""
        return self._inner.log_prob(outputs, _log_variance(outputs, parameters), samples)

    def entropy(self, outputs: Tensor, parameters: Tensor) -> Tensor:
        """Return the entropy of each row."""
        return self._inner.entropy(outputs, _log_variance(outputs, parameters))


def _log_variance(outputs: Tensor, parameters: Tensor) -> Tensor:
    return torch.log(_sum(outputs[1:].square() * torch.exp(2.0 * parameters)[:, None]) + LEAST_VARIANCE)


def _sum(columns: Tensor) -> Tensor:
    """Return the sums of columns. Unlike torch's, that of one does not depend on how many there are."""
    return columns.cumsum(0)[-1]
