"""The joint distribution of a branched hybrid action: Gaussians and categorical branches, all independent.

Branches of different sizes travel as one tensor [lanes, branches, widest]; choices that a branch does not
have, and masked ones, carry a logit of FORBIDDEN, so no code loops over branches. Pure functions of
torch tensors: the readable reference of what `kernels.py` samples and differentiates.
"""

import math
from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor

from joybridge.contract.tensors import Array

FORBIDDEN = -1e9  # a logit whose probability is exactly 0 and whose p·log p is 0, not NaN


def chosen_log_probs(log_p: Tensor, discrete: Tensor, counts: Tensor | None = None) -> Tensor:
    """Return the log-probability of the choices, summed over the branches that count, [lanes].

    log_p [lanes, branches, widest]: log-softmax of the logits; discrete int64 [lanes, branches]; counts bool [lanes,
    branches], None: all do.
    """
    chosen = log_p.gather(-1, discrete.unsqueeze(-1))
    return (chosen if counts is None else chosen.where(counts.unsqueeze(-1), 0.0)).sum((-1, -2))


def branch_entropies(log_p: Tensor, counts: Tensor | None = None) -> Tensor:
    """Return the entropy of each branch, 0 where it does not count, [lanes, branches]."""
    entropies = -(log_p.exp() * log_p).sum(-1)
    return entropies if counts is None else entropies.where(counts, 0.0)


def entropy_of_all(entropies: Tensor, counts: Tensor | None, *, summed: bool) -> Tensor:
    """Return the mean over rows of the entropy of the continuous actions that count in each, 0 if none does.

    entropies [n or 1, continuous]; counts bool [n, continuous], None: all do. summed: of a row, it is the sum over
    actions, as their joint distribution has it; otherwise the mean over them, as in the original.
    """
    if summed:
        return (entropies if counts is None else entropies * counts).sum(1).mean()
    if counts is None:
        return entropies.mean()
    return (entropies * counts / counts.sum(1, keepdim=True).clamp(min=1)).sum(1).mean()


def fill_masks(allowed: Sequence[Array] | None, masks: Array) -> None:
    """Write what to add to the logits into `masks` [lanes, branches, widest]: 0 or FORBIDDEN.

    allowed: which choices each branch allows, bool [lanes, choices]; None: all.
    """
    masks[...] = 0.0
    for branch, mask in enumerate(allowed or ()):
        masks[:, branch, : mask.shape[1]] = np.where(mask, 0.0, FORBIDDEN)


def gaussian_log_probs(
    mean: Tensor, log_variance: Tensor, continuous: Tensor, counts: Tensor | None = None, *, summed: bool = False
) -> tuple[Tensor, Tensor]:
    """Return the log-probability of the samples, summed over dimensions, [lanes], and the entropy, a number.

    mean and continuous [lanes, dimensions], log_variance [dimensions]. counts and summed: see `entropy_of_all`; parts
    that do not count have log-probability and entropy 0. The entropy does not depend on the state.
    """
    squares = (continuous - mean).square() * torch.exp(-log_variance)
    log_probs = squares + log_variance + math.log(2 * math.pi)
    if counts is not None:
        log_probs = log_probs.where(counts, 0.0)
    entropies = math.log(2 * math.pi * math.e) + log_variance
    return -0.5 * log_probs.sum(-1), 0.5 * entropy_of_all(entropies[None], counts, summed=summed)
