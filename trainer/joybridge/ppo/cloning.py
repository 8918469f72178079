"""Behavior cloning: the loss is minus the mean log-probability of what was demonstrated."""

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple, TypeVar

import numpy as np
import torch

from joybridge.ppo.loss import Actions, joint_log_probs
from joybridge.ppo.networks import Network

# The smallest log-variance of a Gaussian that cloning asks for: a deviation of 0.1, a sixtieth of the range of an axis.
# What is always done alike would make it ever smaller.
MIN_LOG_VARIANCE = float(np.log(0.1**2))
ROWS = 4096  # that a network gets at once

Some = TypeVar("Some", bound=Actions)


@torch.no_grad()
def refresh(network: Network, actions: Some) -> Some:
    """Return actions whose sequences begin with what `network` remembers there now; episodes begin with nothing."""
    sequences = actions.sequences
    if sequences is None:
        return actions
    states = torch.zeros_like(sequences.states)
    fresh = replace(actions, sequences=sequences._replace(states=states))
    for part in range(1, int(sequences.parts.max()) + 1):
        continued = torch.nonzero(sequences.parts == part)[:, 0]
        length = int(sequences.lengths[continued[0] - 1])  # of those before them, which are all of full length
        size = max(1, ROWS // length)
        for units in (continued[start : start + size] for start in range(0, len(continued), size)):
            memory = network.heads(fresh.minibatch(units - 1).observations).memory
            assert memory is not None
            states[units] = memory
    return fresh


class Cloning(NamedTuple):
    """What one update learns from demonstrations."""

    minibatches: Iterator[Actions]  # without end
    coef: float  # of the loss
    alone: bool  # PPO then only teaches the critic


def minibatches(actions: Actions, size: int, rng: np.random.Generator) -> Iterator[Actions]:
    """Yield shuffled minibatches without end; each pass takes as many whole ones as there are."""
    size = min(max(1, size * actions.units // len(actions)), actions.units)  # in units
    while True:
        order = torch.from_numpy(rng.permutation(actions.units)).to(actions.discrete.device)
        for start in range(0, actions.units - size + 1, size):
            yield actions.minibatch(order[start : start + size])


def cloning_loss(network: Network, actions: Actions) -> torch.Tensor:
    """Return minus the mean log-probability of what was demonstrated."""
    outputs = network(actions.observations)
    spread = network.log_variance if network.distributions else network.log_variance.clamp(min=MIN_LOG_VARIANCE)
    return -joint_log_probs(outputs, spread, actions, network.distributions)[0].mean()


def add_cloning_gradient(network: Network, actions: Actions, coef: float) -> float:
    """Add the gradient of the loss, times `coef`, to that of the network; return the loss."""
    loss = cloning_loss(network, actions)
    (coef * loss).backward()  # type: ignore[no-untyped-call]
    return float(loss.detach())
