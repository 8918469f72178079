"""A Gaussian that is squashed between its bounds by tanh (Haarnoja et al. 2018)."""

import math

import numpy as np
import torch
from torch import Tensor

from joybridge.layouts import CLIP
from joybridge.ppo.continuous import softplus
from joybridge.ppo.continuous.gaussian import Gaussian

EDGE = 1.0 - 1e-6  # samples stay within ±EDGE x CLIP, where atanh is finite
NODES, WEIGHTS = np.polynomial.hermite_e.hermegauss(32)  # for means over a standard normal number


class Squashed:
    """CLIP x tanh(u), with u from a Gaussian: all samples are within ±CLIP, and none is clipped."""

    outputs = 1
    parameters = 1

    def __init__(self) -> None:
        """Make the Gaussian of u."""
        self._inner = Gaussian()

    def sample(self, outputs: Tensor, parameters: Tensor, noise: Tensor) -> Tensor:
        """Return CLIP x tanh(u)."""
        return CLIP * torch.tanh(self._inner.sample(outputs, parameters, noise)).clamp(-EDGE, EDGE)

    def log_prob(self, outputs: Tensor, parameters: Tensor, samples: Tensor) -> Tensor:
        """Return the log-density of each sample: that of u, less the logarithm of the slope of CLIP x tanh there."""
        share = (samples / CLIP).clamp(-EDGE, EDGE)
        u = 0.5 * (torch.log1p(share) - torch.log1p(-share))  # atanh, with the same result alone and among others
        return self._inner.log_prob(outputs, parameters, u) - _log_slope(u)

    def entropy(self, outputs: Tensor, parameters: Tensor) -> Tensor:
        """Return the entropy: that of u plus the mean of the logarithm of the slope, by Gauss-Hermite quadrature."""
        nodes, weights = (torch.from_numpy(values).to(outputs) for values in (NODES, WEIGHTS / WEIGHTS.sum()))
        u = outputs.t() + torch.exp(0.5 * parameters) * nodes
        return self._inner.entropy(outputs, parameters) + _log_slope(u) @ weights


def _log_slope(u: Tensor) -> Tensor:
    """Return log(CLIP (1 - tanh(u)^2)), which is exact where 1 - tanh(u)^2 would be 0."""
    return math.log(CLIP) + 2.0 * (math.log(2.0) - u - softplus(-2.0 * u))
