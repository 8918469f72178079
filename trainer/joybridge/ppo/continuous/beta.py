"""The beta distribution, whose samples have bounds of their own (Chou, Maturana and Scherer 2017)."""

import math

import torch
from scipy.special import betaincinv, ndtr
from torch import Tensor

from joybridge.layouts import CLIP
from joybridge.ppo.continuous import softplus

EDGE = 1e-6  # samples keep this distance from both ends, as a share of the range: their density is finite


class Beta:
    """x from a beta distribution, moved from 0..1 to ±CLIP.

    Its concentrations a and b are 1 + softplus of the two outputs, so there is one peak.
    """

    outputs = 2
    parameters = 0

    def sample(self, outputs: Tensor, parameters: Tensor, noise: Tensor) -> Tensor:
        """Return the quantile of the noise: as many samples are below it as normal numbers are below the noise."""
        a, b = _concentrations(outputs.double())
        x = torch.from_numpy(betaincinv(a.numpy(), b.numpy(), ndtr(noise.double().numpy())))
        return (CLIP * (2.0 * x.clamp(EDGE, 1.0 - EDGE) - 1.0)).to(outputs.dtype)

    def log_prob(self, outputs: Tensor, parameters: Tensor, samples: Tensor) -> Tensor:
        """Return the log-density of each sample."""
        a, b = _concentrations(outputs)
        x = ((samples / CLIP + 1.0) / 2.0).clamp(EDGE, 1.0 - EDGE)
        return (a - 1.0) * torch.log(x) + (b - 1.0) * torch.log1p(-x) - _log_beta(a, b) - math.log(2.0 * CLIP)

    def entropy(self, outputs: Tensor, parameters: Tensor) -> Tensor:
        """Return the entropy of each row."""
        a, b = _concentrations(outputs)
        digamma = torch.digamma
        peaks = (a - 1.0) * digamma(a) + (b - 1.0) * digamma(b) - (a + b - 2.0) * digamma(a + b)
        return _log_beta(a, b) - peaks + math.log(2.0 * CLIP)


def _concentrations(outputs: Tensor) -> tuple[Tensor, Tensor]:
    first, second = 1.0 + softplus(outputs)
    return first, second


def _log_beta(a: Tensor, b: Tensor) -> Tensor:
    """Return the logarithm of the beta function."""
    return torch.lgamma(a) + torch.lgamma(b) - torch.lgamma(a + b)
