"""What an actor computes in one compiled call: a pass through the network, and an action per row."""

import numpy as np

from joybridge.contract.tensors import Array
from joybridge.ppo.fast.kernels import Action, Noise, compiled, sample
from joybridge.ppo.fast.towers import NetworkShape, gaussians, heads


def empty_action(noise: Noise) -> Action:
    """Return arrays for the actions that some noise gives."""
    normal, uniform = noise
    return Action(np.empty_like(normal), np.empty(uniform.shape, np.int64), np.empty(len(normal), np.float32))


def decide(
    weights: Array, shape: NetworkShape, observations: Array, masks: Array, noise: Noise, likeliest: bool
) -> tuple[Action, Array]:
    """Return an action and a value per row of `observations`; see `heads` and `sample`."""
    action, values = empty_action(noise), np.empty(len(observations), np.float32)
    write_actions(weights, shape, observations, masks, noise, likeliest, action, values)
    return action, values


@compiled
def write_actions(
    weights: Array,
    shape: NetworkShape,
    observations: Array,
    masks: Array,
    noise: Noise,
    likeliest: bool,
    action: Action,
    values: Array,
) -> None:
    """Write what `decide` returns."""
    outputs, values[:] = heads(weights, shape, observations)
    sample(outputs, gaussians(weights, shape), masks, noise, likeliest, action)


@compiled
def write_heads(weights: Array, shape: NetworkShape, observations: Array, outputs: Array, values: Array) -> None:
    """Write what `heads` returns."""
    outputs[:], values[:] = heads(weights, shape, observations)
