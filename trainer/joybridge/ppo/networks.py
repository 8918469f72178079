"""The network of one policy: bodies of dense layers under linear heads for branches, means and the value."""

import math
from collections.abc import Callable
from itertools import pairwise
from typing import NamedTuple

import torch
from torch import Tensor, nn

from joybridge.layouts import ActionSpace
from joybridge.ppo.activations import ACTIVATIONS
from joybridge.ppo.continuous import load_distributions
from joybridge.ppo.convolutions import ImageEncoder
from joybridge.ppo.distributions import FORBIDDEN


class Outputs(NamedTuple):
    """The outputs of the network for a batch of observations."""

    logits: Tensor  # [lanes, branches, widest]
    mean: Tensor  # [lanes, continuous]; with other distributions than Gaussians the outputs of each, side by side
    value: Tensor  # [lanes]


class Tower(nn.Module):
    """Hidden layers and a linear head without bias."""

    def __init__(self, sizes: list[int], outputs: int, activation: str, images: ImageEncoder | None = None) -> None:
        """Make layers between the given sizes, input first, and a head of `outputs`. images: what comes before."""
        super().__init__()
        self.images = images
        if images is not None:
            sizes = [images.features, *sizes[1:]]
        self.activation = ACTIVATIONS[activation]
        self.hidden = nn.ModuleList(nn.Linear(a, b) for a, b in pairwise(sizes))
        self.head = nn.Linear(sizes[-1], outputs, bias=False)

    @property
    def layers(self) -> list[nn.Linear]:
        """Return the hidden layers, input first."""
        return [layer for layer in self.hidden if isinstance(layer, nn.Linear)]

    def forward(self, features: Tensor) -> Tensor:
        """Return the head's outputs [lanes, outputs]."""
        if self.images is not None:
            features = self.images(features)
        for layer in self.hidden:
            features = self.activation(layer(features))
        return self.head(features)  # type: ignore[no-any-return]


class Network(nn.Module):
    """Actor and critic over flat observations: one tower for both, or one each.

    The actor's outputs are the logits of all branches, each padded to the widest, then the means; the value
    comes last, or alone from the critic's tower. Only means and value have a bias. Initialized as the
    original (ML-Agents 0.7): hidden kernels from a truncated normal with variance 1/fan-in, policy heads a
    hundredth of that, the value head Glorot uniform, biases zero. One log-variance per continuous action,
    independent of the state, begins at 0. `distributions` are those of continuous actions, none if all are Gaussians;
    `log_variance` then holds the parameters of all of them.

    `sums` [columns, columns], None without ordinal branches: the logits are the outputs of the tower times this matrix.
    """

    pad: Tensor
    counting: Tensor  # see `ActionSpace.counting`
    sums: Tensor | None

    def __init__(
        self, observation: int, space: ActionSpace, hidden: list[int], shared: bool, seed: int,
        activation: str = "swish", images: Callable[[], ImageEncoder] | None = None,
    ) -> None:  # fmt: skip
        """Make a network for observations of `observation` numbers; `shared`: one tower for both.

        images: makes what comes before the layers of each tower, if observations contain images.
        """
        super().__init__()
        self.space = space
        pad = torch.zeros(len(space.branches), space.widest)
        for branch, size in enumerate(space.branches):
            pad[branch, size:] = FORBIDDEN
        self.register_buffer("pad", pad, persistent=False)
        self.register_buffer("counting", torch.from_numpy(space.counting()), persistent=False)
        sizes = [observation, *hidden]
        self.distributions = load_distributions(space.distributions)
        self._continuous, free = space.continuous, space.continuous  # outputs and parameters of continuous actions
        if self.distributions:
            self._continuous = sum(each.outputs for each in self.distributions)
            free = sum(each.parameters for each in self.distributions)
        columns = pad.numel() + self._continuous + shared
        self.register_buffer("sums", ordinal_sums(space, columns), persistent=False)
        self.actor = Tower(sizes, columns, activation, images() if images else None)
        self.critic = None if shared else Tower(sizes, 1, activation, images() if images else None)
        self.mean_bias = nn.Parameter(torch.zeros(self._continuous))
        self.value_bias = nn.Parameter(torch.zeros(1))
        self.log_variance = nn.Parameter(torch.zeros(free))
        self.flat: Tensor | None = None  # all parameters; see `flatten_parameters`
        self._initialize(torch.Generator().manual_seed(seed))

    def _initialize(self, generator: torch.Generator) -> None:
        for tower in (self.actor, self.critic):
            layers: list[nn.Linear | nn.Conv2d] = []
            if tower is not None:
                layers = [*(tower.images.layers if tower.images is not None else ()), *tower.layers]
            for layer in layers:
                _variance_scaling(layer.weight.flatten(1), 1.0, generator)
                if layer.bias is not None:
                    nn.init.zeros_(layer.bias)
        policy = self.actor.head.weight[: self.pad.numel() + self._continuous]
        _variance_scaling(policy, 0.01, generator)
        value = (self.critic or self.actor).head.weight[-1:]
        nn.init.xavier_uniform_(value, generator=generator)

    def heads(self, observations: Tensor) -> tuple[Tensor, Tensor]:
        """Return the actor's outputs [lanes, columns], without mask and bias, and the values [lanes]."""
        outputs = self.actor(observations)
        value = outputs if self.critic is None else self.critic(observations)
        if self.sums is not None:
            outputs = outputs @ self.sums
        return outputs, value[:, -1] + self.value_bias

    def forward(self, observations: Tensor) -> Outputs:
        """Return what `heads` does, taken apart."""
        outputs, value = self.heads(observations)
        logits = outputs[:, : self.pad.numel()].view(len(outputs), *self.pad.shape) + self.pad
        return Outputs(logits, self.continuous(outputs), value)

    def continuous(self, outputs: Tensor) -> Tensor:
        """Return the means, or what other distributions get, from the outputs of `heads`."""
        return outputs[:, self.pad.numel() : self.pad.numel() + self._continuous] + self.mean_bias

    def value(self, observations: Tensor) -> Tensor:
        """Return the values [lanes] alone."""
        return (self.critic or self.actor)(observations)[:, -1] + self.value_bias  # type: ignore[no-any-return]


def ordinal_sums(space: ActionSpace, columns: int) -> Tensor | None:
    """Return the matrix that turns the outputs of a tower into logits, [columns, columns]; None: they are equal.

    The ordinal logits of Tang and Agrawal (2020) are sums of log s and log(1 - s), with s the sigmoid of an output. The
    difference of the two is the output itself. So but for a summand that all choices share, and that the softmax
    ignores, the logit of a choice is the sum of the outputs up to its own.
    """
    if not space.ordinal:
        return None
    sums = torch.eye(columns)
    for branch in space.ordinal:
        begin, end = branch * space.widest, branch * space.widest + space.branches[branch]
        sums[begin:end, begin:end] = torch.ones(end - begin, end - begin).triu()
    return sums


def flatten_parameters(network: Network) -> Tensor:
    """Move all parameters and their gradients into two flat tensors, once; return the one with the parameters.

    The optimizer then steps one tensor instead of a dozen, and copying a network is copying one array. Their order:
    mean_bias, value_bias, log_variance, then the layers of the actor and of the critic, weight before bias.
    """
    if network.flat is not None:
        return network.flat
    parameters = list(network.parameters())
    flat = torch.cat([parameter.detach().reshape(-1) for parameter in parameters]).requires_grad_()
    flat.grad = torch.zeros_like(flat)
    begin = 0
    for parameter in parameters:
        end = begin + parameter.numel()
        parameter.data = flat.data[begin:end].view_as(parameter)
        parameter.grad = flat.grad[begin:end].view_as(parameter)
        begin = end
    network.flat = flat
    return flat


def _variance_scaling(weight: Tensor, factor: float, generator: torch.Generator) -> None:
    # 1.3 makes up for what cutting the normal at two standard deviations takes from its variance.
    std = math.sqrt(1.3 * factor / weight.shape[1])
    nn.init.trunc_normal_(weight, 0.0, std, -2 * std, 2 * std, generator=generator)
