"""Distributions of single continuous actions, beside the Gaussian in closed form: by autograd, from any package.

A layout names the distribution of an axis as "module:Class" (`AxisRange.distribution`), so layouts need no torch. A
distribution is about samples in the units of the Gaussian: they act limited to ±3 and divided by 3 (`CLIP`).
"""

import pkgutil
from collections.abc import Sequence
from typing import Protocol

import torch
from torch import Tensor

from joybridge.config.errors import ConfigError


class Distribution(Protocol):
    """The distribution of one continuous action. n: lanes or timesteps; every row is independent of the others.

    `parameters` are learned as well, begin at 0 and do not depend on the observation, as the log-variance of a
    Gaussian. The network's outputs begin near 0.
    """

    outputs: int  # of the network, for each action
    parameters: int

    def sample(self, outputs: Tensor, parameters: Tensor, noise: Tensor) -> Tensor:
        """Return a sample per row, [n].

        outputs [outputs, n], parameters [parameters], noise [n]: standard normal numbers. A noise of 0 gives what is
        played if nothing is to be left to chance.
        """

    def log_prob(self, outputs: Tensor, parameters: Tensor, samples: Tensor) -> Tensor:
        """Return the log-density of each sample, [n], from which autograd takes gradients."""

    def entropy(self, outputs: Tensor, parameters: Tensor) -> Tensor:
        """Return the entropy of each row, [n], from which autograd takes gradients."""


def load_distributions(names: Sequence[str]) -> list[Distribution]:
    """Return the distributions with these names, "module:Class" each. Raises ConfigError."""
    distributions = []
    for name in names:
        try:
            distributions.append(pkgutil.resolve_name(name)())
        except Exception as error:
            raise ConfigError(f"layout: the distribution {name!r} cannot be loaded: {error}") from error
    return distributions


def sample_each(distributions: Sequence[Distribution], outputs: Tensor, parameters: Tensor, noise: Tensor) -> Tensor:
    """Return samples [n, actions]. outputs: of all actions side by side, as `parameters`; noise [n, actions]."""
    parts = _parts(distributions, outputs, parameters)
    samples = [each.sample(rows, own, noise[:, i]) for i, (each, rows, own) in enumerate(parts)]
    return torch.stack(samples, 1)


def log_probs_of_each(
    distributions: Sequence[Distribution],
    outputs: Tensor,
    parameters: Tensor,
    samples: Tensor,
    counts: Tensor | None = None,
) -> Tensor:
    """Return the log-densities of samples [n, actions], summed over the actions that count, [n].

    counts: bool [n, actions]; None: all do.
    """
    parts = _parts(distributions, outputs, parameters)
    each_own = torch.stack([each.log_prob(rows, own, samples[:, i]) for i, (each, rows, own) in enumerate(parts)])
    return each_own.sum(0) if counts is None else each_own.where(counts.t(), 0.0).sum(0)


def entropies_of_each(distributions: Sequence[Distribution], outputs: Tensor, parameters: Tensor) -> Tensor:
    """Return the entropies of each action, [actions, n]."""
    parts = _parts(distributions, outputs, parameters)
    return torch.stack([each.entropy(rows, own) for each, rows, own in parts])


def _parts(
    distributions: Sequence[Distribution], outputs: Tensor, parameters: Tensor
) -> list[tuple[Distribution, Tensor, Tensor]]:
    """Return each distribution with its part of the outputs, [outputs, n], and its parameters."""
    parts, row, begin = [], 0, 0
    for each in distributions:
        parts.append((each, outputs.t()[row : row + each.outputs], parameters[begin : begin + each.parameters]))
        row, begin = row + each.outputs, begin + each.parameters
    return parts


def softplus(x: Tensor) -> Tensor:
    """Return log(1 + exp(x)). Unlike torch's, the result of a number does not depend on how many there are."""
    return torch.relu(x) + torch.log1p(torch.exp(-x.abs()))
