"""The network of one policy: encoders of images and dense layers, with heads for branches, means and the value."""

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor, nn

from joybridge.layouts import ActionSpace
from joybridge.ppo.activations import ACTIVATIONS
from joybridge.ppo.continuous import features_of, load_distributions, noise_holds
from joybridge.ppo.convolutions import ImageEncoder
from joybridge.ppo.distributions import FORBIDDEN
from joybridge.ppo.memory import Memory, Recall
from joybridge.ppo.observation_tensors import Observations
from joybridge.ppo.own import OwnEncoder
from joybridge.ppo.pointing import Pointers


class Outputs(NamedTuple):
    """The outputs of the network for a batch of observations."""

    logits: Tensor  # [lanes, branches, widest]
    mean: Tensor  # [lanes, continuous]; with other distributions than Gaussians what each gets, side by side
    value: Tensor  # [lanes]


class Heads(NamedTuple):
    """The outputs of a network before they are taken apart."""

    outputs: Tensor  # [lanes, columns], of the actor, without mask and bias; last, features that distributions see
    value: Tensor  # [lanes]
    memory: Tensor | None  # [sequences, state_size]: the states after this; None: a network without memory


class MemoryKind(NamedTuple):
    """Which memory each tower has."""

    kind: str  # "gru" or "lstm"
    size: int


class Tower(nn.Module):
    """Hidden layers, perhaps a memory, and a linear head without bias."""

    def __init__(self, sizes: list[int], outputs: int, activation: str, memory: MemoryKind | None) -> None:
        """Make layers between the given sizes, input first, and a head of `outputs`."""
        super().__init__()
        self.activation = ACTIVATIONS[activation]
        self.hidden = nn.ModuleList(nn.Linear(a, b) for a, b in pairwise(sizes))
        self.memory = None if memory is None else Memory(memory.kind, sizes[-1], memory.size)
        self.head = nn.Linear(sizes[-1] if memory is None else memory.size, outputs, bias=False)

    @property
    def layers(self) -> list[nn.Linear]:
        """Return the hidden layers, input first."""
        return [layer for layer in self.hidden if isinstance(layer, nn.Linear)]

    def forward(self, features: Tensor, recall: Recall | None = None) -> tuple[Tensor, Tensor | None]:
        """Return what the head gets, [rows, features], and the states of its memory, if it has one."""
        for layer in self.hidden:
            features = self.activation(layer(features))
        if self.memory is None:
            return features, None
        assert recall is not None
        features, states = self.memory(features, recall)
        return features, states


class Towers(NamedTuple):
    """The layers between observations and outputs."""

    hidden: Sequence[int]  # units of each layer
    shared: bool = False  # one tower for actor and critic
    activation: str = "swish"
    memory: MemoryKind | None = None  # of each tower


class Network(nn.Module):
    """Actor and critic: one tower for both, or one each, over numbers and the features of images.

    The actor's outputs are the logits of all branches, each padded to the widest, then the means; the value
    comes last, or alone from the critic's tower. Only means and value have a bias. Initialized as the
    original (ML-Agents 0.7): hidden kernels from a truncated normal with variance 1/fan-in, policy heads a
    hundredth of that, the value head Glorot uniform, biases zero. One log-variance per continuous action,
    independent of the state, begins at 0. `distributions` are those of continuous actions, none if all are Gaussians;
    `log_variance` then holds the parameters of all of them.

    `pointers`, None without maps: the logits of maps are not in the head of the tower, but come from the convolutions.

    `sums` [columns, columns], None without ordinal branches: the logits are the outputs of the tower times this matrix.
    """

    pad: Tensor
    sums: Tensor | None

    def __init__(
        self,
        observation: int,
        space: ActionSpace,
        towers: Towers,
        seed: int,
        encoders: Sequence[ImageEncoder | OwnEncoder] = (),
    ) -> None:
        """Make a network for observations of `observation` numbers.

        encoders: what comes before the towers, if anything does: one for both, or one each.
        """
        hidden, shared, activation, memory = towers
        super().__init__()
        self.encoders = nn.ModuleList(encoders)
        self.space = space
        pad = torch.zeros(len(space.branches), space.widest)
        for branch, size in enumerate(space.branches):
            pad[branch, size:] = FORBIDDEN
        self.register_buffer("pad", pad, persistent=False)
        sizes = [encoders[0].features if encoders else observation, *hidden]
        self.distributions = load_distributions(space.distributions, memory.size if memory else sizes[-1])
        self._continuous, free = space.continuous, space.continuous  # outputs and parameters of continuous actions
        self.noise_holds = np.ones(space.continuous, np.int64)  # see the function of this name
        if self.distributions:
            self.noise_holds = noise_holds(self.distributions)
            self._continuous = sum(each.outputs for each in self.distributions)
            free = sum(each.parameters for each in self.distributions)
        self.shown = max(map(features_of, self.distributions), default=0)  # features that distributions see
        columns = pad.numel() + self._continuous + shared
        self.register_buffer("sums", ordinal_sums(space, columns), persistent=False)
        self.pointers = None
        if space.maps and isinstance(encoders[0], ImageEncoder):
            self.pointers = Pointers(space, self._continuous, shared, encoders[0])
        self.actor = Tower(sizes, self.pointers.columns if self.pointers else columns, activation, memory)
        self.critic = None if shared else Tower(sizes, 1, activation, memory)
        self.state_size = sum(each.state_size for each in self.memories)  # numbers that a lane remembers
        self.mean_bias = nn.Parameter(torch.zeros(self._continuous))
        self.value_bias = nn.Parameter(torch.zeros(1))
        self.log_variance = nn.Parameter(torch.zeros(free))
        self.flat: Tensor | None = None  # all parameters; see `flatten_parameters`
        self._initialize(torch.Generator().manual_seed(seed))

    @property
    def memories(self) -> list[Memory]:
        """Return the memories of the towers."""
        towers = [self.actor] if self.critic is None else [self.actor, self.critic]
        return [tower.memory for tower in towers if tower.memory is not None]

    def _initialize(self, generator: torch.Generator) -> None:
        ours = [encoder for encoder in self.encoders if isinstance(encoder, ImageEncoder)]
        encoded = [module for encoder in ours for module in encoder.modules()]
        layers = [module for module in encoded if isinstance(module, nn.Conv2d | nn.Linear)]
        layers += [layer for tower in (self.actor, self.critic) if tower is not None for layer in tower.layers]
        for layer in layers:
            _variance_scaling(layer.weight.flatten(1), 1.0, generator)
            if layer.bias is not None:
                nn.init.zeros_(layer.bias)
        for memory in self.memories:
            for name, weight in memory.layer.named_parameters():
                if "bias" in name:
                    nn.init.zeros_(weight)
                elif "hh" in name:  # orthogonal, so that what is remembered neither grows nor fades at first
                    for gate in torch.split(weight.data, memory.layer.hidden_size):
                        nn.init.orthogonal_(gate, generator=generator)
                else:
                    _variance_scaling(weight, 1.0, generator)
        policy = self.actor.head.weight[: len(self.actor.head.weight) - (self.critic is None)]
        _variance_scaling(policy, 0.01, generator)
        value = (self.critic or self.actor).head.weight[-1:]
        nn.init.xavier_uniform_(value, generator=generator)

    def heads(self, observations: Observations) -> Heads:
        """Return what the towers make of observations."""
        encoded = [encoder(observations) for encoder in self.encoders]
        features = [each.features for each in encoded] or [observations.numbers]
        first, second = self._recalls(observations.recall)
        seen, memory = self.actor(features[0], first)
        value = outputs = self.actor.head(seen)
        if self.critic is not None:
            other_seen, other = self.critic(features[-1], second)
            value = self.critic.head(other_seen)
            memory = None if memory is None else torch.cat([memory, other], dim=1)
        if self.pointers is not None:
            outputs = self.pointers(outputs, encoded[0].maps)
        if self.sums is not None:
            outputs = outputs @ self.sums
        if self.shown:
            outputs = torch.cat([outputs, seen.detach()], dim=1)
        return Heads(outputs, value[:, -1] + self.value_bias, memory)

    def _recalls(self, recall: Recall | None) -> tuple[Recall | None, Recall | None]:
        """Return what each tower remembers: their states are side by side."""
        if recall is None or self.critic is None:
            return recall, None
        actors, critics = recall.states.chunk(2, dim=1)
        return Recall(actors, recall.lengths), Recall(critics, recall.lengths)

    def forward(self, observations: Observations) -> Outputs:
        """Return what `heads` does, taken apart."""
        outputs, value, _ = self.heads(observations)
        logits = outputs[:, : self.pad.numel()].view(len(outputs), *self.pad.shape) + self.pad
        return Outputs(logits, self.continuous(outputs), value)

    def continuous(self, outputs: Tensor) -> Tensor:
        """Return the means, or what other distributions get, from the outputs of `heads`."""
        means = outputs[:, self.pad.numel() : self.pad.numel() + self._continuous] + self.mean_bias
        return torch.cat([means, outputs[:, -self.shown :]], dim=1) if self.shown else means


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
