"""The joint distribution of a branched hybrid action: Gaussians and categorical branches, all independent.

Branches of different sizes travel as one tensor [lanes, branches, widest]; choices that a branch does not
have, and masked ones, carry a logit of FORBIDDEN, so no code loops over branches. Pure functions of
torch tensors; sampling and re-evaluation share them, which is why the first ratio of an update is 1.
"""

import math

import torch
from torch import Tensor

FORBIDDEN = -1e9  # a logit whose probability is exactly 0 and whose p·log p is 0, not NaN


def chosen_log_probs(log_p: Tensor, discrete: Tensor) -> Tensor:
    """Return the log-probability of the choices, summed over branches, [lanes].

    log_p [lanes, branches, widest]: log-softmax of the logits; discrete int64 [lanes, branches].
    """
    return log_p.gather(-1, discrete.unsqueeze(-1)).sum((-1, -2))


def branch_entropy(log_p: Tensor) -> Tensor:
    """Return the entropy, summed over branches, [lanes]."""
    return -(log_p.exp() * log_p).sum((-1, -2))


def gaussian_log_probs(mean: Tensor, log_variance: Tensor, continuous: Tensor) -> tuple[Tensor, Tensor]:
    """Return the log-probability of the samples, summed over dimensions, [lanes], and the entropy, a number.

    mean and continuous [lanes, dimensions], log_variance [dimensions]. As in the original, the entropy is
    the mean over dimensions, not the sum, and does not depend on the state.
    """
    squares = (continuous - mean).square() * torch.exp(-log_variance)
    log_probs = -0.5 * (squares + log_variance + math.log(2 * math.pi)).sum(-1)
    return log_probs, 0.5 * (math.log(2 * math.pi * math.e) + log_variance).mean()


def sample_branches(log_p: Tensor, uniform: Tensor) -> Tensor:
    """Return one choice per branch, int64 [lanes, branches], by inverting the cumulative distribution.

    log_p as in `chosen_log_probs`, uniform [lanes, branches] in [0, 1).
    """
    cumulative = log_p.exp().cumsum(-1)
    # Rounding may leave the last sum below u; scaling by it keeps forbidden choices at the end unreachable.
    threshold = uniform.unsqueeze(-1) * cumulative[..., -1:]
    return (cumulative <= threshold).sum(-1).clamp_(max=log_p.shape[-1] - 1)


def sample_gaussians(mean: Tensor, log_variance: Tensor, normal: Tensor) -> Tensor:
    """Return samples [lanes, dimensions] from standard normal noise of the same shape."""
    return mean + torch.exp(0.5 * log_variance) * normal
