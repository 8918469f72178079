"""The network of one policy: swish bodies, a head for the branches, one for the means, one for the value."""

import math
from itertools import pairwise
from typing import NamedTuple

import torch
from torch import Tensor, nn

from trainer.actions import ActionSpace
from trainer.distributions import FORBIDDEN


class Outputs(NamedTuple):
    """What the network says of a batch of observations."""

    logits: Tensor  # [lanes, branches, widest]
    mean: Tensor  # [lanes, continuous]
    value: Tensor  # [lanes]


class Network(nn.Module):
    """Actor and critic over flat observations.

    Initialised as the original (ML-Agents 0.7): hidden kernels from a truncated normal with variance
    1/fan-in, policy heads a hundredth of that variance, the value head Glorot uniform, biases zero. The
    branch head has no bias. One log-variance per continuous action, independent of the state, begins at 0.
    """

    pad: Tensor

    def __init__(self, observation: int, space: ActionSpace, hidden: list[int], shared: bool, seed: int) -> None:
        """Make a network for observations of `observation` numbers; `shared`: one body for actor and critic."""
        super().__init__()
        self.space = space
        self.widest = max(space.branches, default=0)
        sizes = [observation, *hidden]
        self.body = make_body(sizes)
        self.value_body = None if shared else make_body(sizes)
        branches = len(space.branches) * self.widest
        self.branch_head = nn.Linear(sizes[-1], branches, bias=False) if branches else None
        self.mean_head = nn.Linear(sizes[-1], space.continuous) if space.continuous else None
        self.value_head = nn.Linear(sizes[-1], 1)
        self.log_variance = nn.Parameter(torch.zeros(space.continuous))
        pad = torch.zeros(len(space.branches), self.widest)
        for branch, size in enumerate(space.branches):
            pad[branch, size:] = FORBIDDEN
        self.register_buffer("pad", pad, persistent=False)
        self._initialise(torch.Generator().manual_seed(seed))

    def _initialise(self, generator: torch.Generator) -> None:
        for name, layer in self.named_modules():
            if not isinstance(layer, nn.Linear):
                continue
            if layer.bias is not None:
                nn.init.zeros_(layer.bias)
            if layer is self.value_head:
                nn.init.xavier_uniform_(layer.weight, generator=generator)
                continue
            variance = 0.01 if name in ("branch_head", "mean_head") else 1.0
            # 1.3 makes up for what cutting the normal at two standard deviations takes from its variance.
            std = math.sqrt(1.3 * variance / layer.in_features)
            nn.init.trunc_normal_(layer.weight, 0.0, std, -2 * std, 2 * std, generator=generator)

    def forward(self, observations: Tensor) -> Outputs:
        """Return the outputs for observations [lanes, observation]."""
        features = run_body(self.body, observations)
        critic_features = features if self.value_body is None else run_body(self.value_body, observations)
        none = features.new_empty(len(features), 0)
        logits = self.branch_head(features).view(-1, *self.pad.shape) + self.pad if self.branch_head else none
        mean = self.mean_head(features) if self.mean_head else none
        return Outputs(logits, mean, self.value_head(critic_features).squeeze(-1))

    def value(self, observations: Tensor) -> Tensor:
        """Return the values [lanes] alone."""
        return self.value_head(run_body(self.value_body or self.body, observations)).squeeze(-1)  # type: ignore[no-any-return]


def make_body(sizes: list[int]) -> nn.ModuleList:
    """Return the hidden layers between the given sizes."""
    return nn.ModuleList(nn.Linear(a, b) for a, b in pairwise(sizes))


def run_body(body: nn.ModuleList, features: Tensor) -> Tensor:
    """Return the last hidden layer's activations; the activation is swish, x · sigmoid(x)."""
    for layer in body:
        features = nn.functional.silu(layer(features))
    return features
