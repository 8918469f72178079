"""The critic of a clone: a linear regression of what the demonstrations earned on what the last layer sees.

PPO that begins with a policy and without a critic takes its first updates from noise, and can lose the policy by them.
The layers below the value head stay as they are, because those of a shared body are the policy's.
"""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from joybridge.demonstrations.returns import Demonstrated
from joybridge.ppo.networks import Network
from joybridge.ppo.update import explained_variance

RIDGES = (1e-4, 1e-2, 1.0)  # of the mean square of a feature; the best on held-out decisions is taken
RIDGE = 1e-2  # where nothing is held out


class Line(NamedTuple):
    """A value as a linear function of features."""

    weights: Tensor  # float64 [features]
    bias: Tensor  # float64, a number

    def at(self, features: Tensor) -> Tensor:
        """Return the values of rows of features."""
        return features @ self.weights + self.bias


def fit_critic(
    network: Network, learned: Iterable[Demonstrated], held_out: Iterable[Demonstrated], scale: float
) -> float:
    """Set the value head to predict the returns in parts of demonstrations, divided by `scale`.

    Return the share of the variance of held-out returns that it explains; NaN if nothing is held out.
    """
    (features, returns), (other, others) = (_features(network, parts, scale) for parts in (learned, held_out))
    lines = [_regression(features, returns, ridge) for ridge in (RIDGES if len(others) else (RIDGE,))]
    explained, best = np.nan, lines[0]
    if len(others):
        lines.append(Line(torch.zeros_like(best.weights), returns.mean()))  # features that tell nothing
        best = min(lines, key=lambda line: float((line.at(other) - others).square().mean()))
        explained = explained_variance(best.at(other), others)
    tower = network.critic or network.actor
    with torch.no_grad():
        tower.head.weight[-1].copy_(best.weights)
        network.value_bias.copy_(best.bias)
    return explained


@torch.no_grad()
def _features(network: Network, parts: Iterable[Demonstrated], scale: float) -> tuple[Tensor, Tensor]:
    """Return what comes to the value head in all parts, float64 [n, features], and the scaled returns, float64 [n]."""
    seen: list[Tensor] = []
    returns: list[Tensor] = []
    tower = network.critic or network.actor
    for part in parts:  # making one may pass through the network, too, which the hook must not see
        hook = tower.head.register_forward_pre_hook(lambda module, inputs: seen.append(inputs[0].double()))
        try:
            network.heads(part.observations)
        finally:
            hook.remove()
        returns.append(part.returns.double() / scale)
    if not seen:
        return torch.zeros(0, tower.head.in_features), torch.zeros(0)
    return torch.cat(seen), torch.cat(returns)


def _regression(features: Tensor, values: Tensor, ridge: float) -> Line:
    """Return the line with the least squares, and small weights."""
    middle, mean = features.mean(0), values.mean()
    centered = features - middle
    products = centered.T @ centered
    penalty = ridge * products.diagonal().mean().clamp(min=1e-12)
    products.diagonal().add_(penalty)
    weights = torch.linalg.solve(products, centered.T @ (values - mean))
    return Line(weights, mean - middle @ weights)
