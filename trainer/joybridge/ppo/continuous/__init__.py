"""Distributions of single continuous actions, beside the Gaussian in closed form: by autograd, from any package.

A layout names the distribution of an axis as "module:Class" (`AxisRange.distribution`), so layouts need no torch. A
distribution is about samples in the units of the Gaussian: they act limited to ±3 and divided by 3 (`CLIP`).

One named "module:Class-N" also sees the features, which are what the actor's head gets, and keeps its noise for N
decisions. It is made as Class(N, features) and has these as `hold` and `features`. Its outputs are followed by the
features, without a gradient, and its noise is [features, n].
"""

import pkgutil
from collections.abc import Sequence
from typing import Protocol

import numpy as np
import torch
from torch import Tensor

from joybridge.config.errors import ConfigError
from joybridge.contract.tensors import Array


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


def load_distributions(names: Sequence[str], features: int) -> list[Distribution]:
    """Return the distributions with these names. features: how many those get that see them. Raises ConfigError."""
    distributions = []
    for name in names:
        place, _, hold = name.partition("-")
        try:
            made = pkgutil.resolve_name(place)
            distributions.append(made(int(hold), features) if hold else made())
        except Exception as error:
            raise ConfigError(f"layout: the distribution {name!r} cannot be loaded: {error}") from error
    return distributions


def features_of(distribution: Distribution) -> int:
    """Return how many features a distribution sees, 0 if it sees none."""
    return getattr(distribution, "features", 0)


def noise_holds(distributions: Sequence[Distribution]) -> Array:
    """Return for how many decisions each normal number of the noise is kept, int64 [numbers]."""
    return np.concatenate(
        [np.full(max(1, features_of(each)), getattr(each, "hold", 1), np.int64) for each in distributions]
    )


def sample_each(distributions: Sequence[Distribution], outputs: Tensor, parameters: Tensor, noise: Tensor) -> Tensor:
    """Return samples [n, actions].

    outputs: of all actions side by side, as `parameters`, then the features, if any of them sees these; noise
    [n, numbers]: see `noise_holds`.
    """
    samples, begin = [], 0
    for each, rows, own in _parts(distributions, outputs, parameters):
        features = features_of(each)
        numbers = noise[:, begin : begin + features].t() if features else noise[:, begin]
        samples.append(each.sample(rows, own, numbers))
        begin += max(1, features)
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
    """Return each distribution with its part of the outputs, [outputs + features, n], and its parameters."""
    parts, row, begin, columns = [], 0, 0, outputs.t()
    for each in distributions:
        rows, features = columns[row : row + each.outputs], features_of(each)
        if features:
            rows = torch.cat([rows, columns[-features:]])
        parts.append((each, rows, parameters[begin : begin + each.parameters]))
        row, begin = row + each.outputs, begin + each.parameters
    return parts


def softplus(x: Tensor) -> Tensor:
    """Return log(1 + exp(x)). Unlike torch's, the result of a number does not depend on how many there are.

    Its gradient at 0 is one half, where those of the absolute value and of relu are 0.
    """
    positive = x > 0
    return torch.where(positive, x, 0.0) + torch.log1p(torch.exp(torch.where(positive, -x, x)))
