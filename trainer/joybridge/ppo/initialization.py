"""What a network begins with where that is not its default, which is that of ML-Agents 0.7."""

import math
from collections.abc import Mapping, Sequence

import torch
from torch import nn

from joybridge.layouts.layout import GSDE
from joybridge.ppo.convolutions import ImageEncoder
from joybridge.ppo.networks import Network


@torch.no_grad()
def orthogonal(network: Network, seed: int) -> None:
    """Make weights orthogonal (Saxe et al. 2014), with the gains of Stable-Baselines3 and CleanRL; biases are 0.

    Those are the weights of hidden layers and convolutions (gain √2), of policy heads (0.01) and of values (1). A
    memory stays as it is, and so does a network of the user's own.
    """
    generator = torch.Generator().manual_seed(seed)
    towers = [tower for tower in (network.actor, network.critic) if tower is not None]
    ours = [encoder for encoder in network.encoders if isinstance(encoder, ImageEncoder)]
    modules = [module for encoder in ours for module in encoder.modules()]
    for module in (*modules, *(layer for tower in towers for layer in tower.layers)):
        if isinstance(module, nn.Conv2d | nn.Linear):
            nn.init.orthogonal_(module.weight, math.sqrt(2.0), generator=generator)
    head = network.actor.head.weight
    shared = network.critic is None
    nn.init.orthogonal_(head[: len(head) - shared], 0.01, generator=generator)
    nn.init.orthogonal_(towers[-1].head.weight[-1:], 1.0, generator=generator)


@torch.no_grad()
def set_log_std(network: Network, log_std: float | Mapping[str, float], names: Sequence[str]) -> None:
    """Set the deviations that Gaussians begin with, squashed ones included, to the exponential of `log_std`.

    With `gsde-N`, these are the deviations of the coefficients. names: what the continuous actions act on; `log_std`
    names those of them that have a Gaussian.
    """
    kinds = network.space.with_deviation(names)
    counts = [each.parameters for each in network.distributions] or [1] * len(names)
    parts = dict(zip(names, torch.split(network.log_variance, counts), strict=True))
    given = log_std if isinstance(log_std, Mapping) else dict.fromkeys(kinds, log_std)
    for name, value in given.items():
        scale = 1.0 if kinds[name] == GSDE else 2.0  # parameters of the others are log-variances
        parts[name].fill_(scale * value)
