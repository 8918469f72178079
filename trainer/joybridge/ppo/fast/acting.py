"""What an actor computes in one compiled call: a pass through the network, and an action per row."""

from joybridge.contract.tensors import Array
from joybridge.ppo.fast.kernels import Action, Noise, compiled, sample
from joybridge.ppo.fast.towers import Form, gaussians, heads


@compiled
def decide(
    weights: Array,
    form: Form,
    observations: Array,
    masks: Array,
    noise: Noise,
    likeliest: bool,
    action: Action,
    values: Array,
) -> None:
    """Write an action and a value per row of `observations`; see `heads` and `sample`."""
    outputs, values[:] = heads(weights, form, observations)
    sample(outputs, gaussians(weights, form), masks, noise, likeliest, action)


@compiled
def write_heads(weights: Array, form: Form, observations: Array, outputs: Array, values: Array) -> None:
    """Write what `heads` returns."""
    outputs[:], values[:] = heads(weights, form, observations)
