"""Dense networks on the processor, compiled by Numba: forward pass, backward pass and activations.

PyTorch takes longer to start operations on matrices of this size than to compute them, so a whole pass is one compiled
function. Its matrix products are those of BLAS. The readable reference is `ppo/networks.py`; tests hold these functions
to it.

Shapes: n rows. All parameters are one flat array, and so are their gradients: see `flatten_parameters`.
"""

from typing import NamedTuple

import numpy as np

from joybridge.contract.tensors import Array
from joybridge.ppo.activations import ACTIVATIONS
from joybridge.ppo.fast.kernels import Head, compiled
from joybridge.ppo.networks import Network

SWISH, TANH, RELU, ELU = (list(ACTIVATIONS).index(name) for name in ("swish", "tanh", "relu", "elu"))
NO_SUMS = np.zeros((0, 0), np.float32)


class NetworkShape(NamedTuple):
    """What is known about a network of dense layers beside its parameters."""

    widths: Array  # int64: of the input and of each hidden layer
    choices: Array  # int64 [branches]
    sums: Array  # see `Network`; NO_SUMS without ordinal branches
    columns: int  # of the outputs of the actor
    means: int
    free: int  # parameters of the continuous actions that do not depend on the observation
    shared: bool  # whether actor and critic are one tower
    activation: int


def shape_of(network: Network) -> NetworkShape:
    """Return the shape of a network of dense layers."""
    layers = network.actor.layers
    head = network.actor.head
    return NetworkShape(
        widths=np.array([*(layer.in_features for layer in layers), head.in_features], np.int64),
        choices=np.array(network.space.branches, np.int64),
        sums=NO_SUMS if network.sums is None else network.sums.numpy(),
        columns=head.out_features,
        means=network.mean_bias.numel(),
        free=network.log_variance.numel(),
        shared=network.critic is None,
        activation=list(ACTIVATIONS.values()).index(network.actor.activation),
    )


@compiled
def logistic(x: np.float32) -> np.float32:
    """Return the sigmoid of x, float32, within 2e-7.

    It is 1/2 + tanh(x / 2) / 2 with the tanh as a quotient of polynomials, fitted to be best in the largest relative
    error (2e-8): unlike exp, the compiler can compute it for several numbers at once.
    """
    half = min(max(np.float32(0.5) * x, np.float32(-9.0)), np.float32(9.0))
    t = half * half
    upper = np.float32(2.060818406521144e-05) + t * np.float32(1.3353412140939418e-08)
    upper = np.float32(0.13380981115370058) + t * (np.float32(0.003495534492908673) + t * upper)
    lower = np.float32(0.0003285546251995628) + t * np.float32(7.776046756974994e-07)
    lower = np.float32(0.467142967737394) + t * (np.float32(0.025876779923792472) + t * lower)
    tanh = half * (np.float32(0.9999999796284383) + t * upper) / (np.float32(1.0) + t * lower)
    return np.float32(0.5) + np.float32(0.5) * tanh


@compiled
def activate(activation: int, z: Array, bias: Array, slope: Array) -> None:
    """Replace z [n, width] by the activation of z + bias, and write its derivative into `slope`, of the same shape."""
    one, zero = np.float32(1.0), np.float32(0.0)
    for i in range(len(z)):
        if activation == SWISH:
            for j in range(len(bias)):
                x = z[i, j] + bias[j]
                gate = logistic(x)
                value = x * gate
                z[i, j], slope[i, j] = value, gate + value * (one - gate)
        elif activation == TANH:
            for j in range(len(bias)):
                value = np.float32(np.tanh(z[i, j] + bias[j]))
                z[i, j], slope[i, j] = value, one - value * value
        elif activation == RELU:
            for j in range(len(bias)):
                x = z[i, j] + bias[j]
                z[i, j], slope[i, j] = max(x, zero), one if x > zero else zero
        else:
            for j in range(len(bias)):
                x = z[i, j] + bias[j]
                value = x if x > zero else np.float32(np.expm1(x))
                z[i, j], slope[i, j] = value, min(value, zero) + one


@compiled
def matrix(flat: Array, begin: int, rows: int, columns: int) -> Array:
    """Return the part of a flat array that begins at `begin` as a matrix."""
    return flat[begin : begin + rows * columns].reshape((rows, columns))


@compiled
def hidden_width(shape: NetworkShape) -> int:
    """Return how many numbers the hidden layers of a tower keep per row."""
    return shape.widths[1:].sum()  # type: ignore[no-any-return]


@compiled
def tower_size(shape: NetworkShape, outputs: int) -> int:
    """Return the number of parameters of a tower with a head of so many outputs."""
    size = outputs * shape.widths[-1]
    for index in range(1, len(shape.widths)):
        size += (shape.widths[index - 1] + 1) * shape.widths[index]
    return size  # type: ignore[no-any-return]


@compiled
def gaussians(flat: Array, shape: NetworkShape) -> Head:
    """Return mean_bias and log_variance, which are views of `flat`, with what is known about branches and actions."""
    begin = shape.means + 1
    return Head(flat[: shape.means], flat[begin : begin + shape.free], shape.choices)


@compiled
def actor_begin(shape: NetworkShape) -> int:
    """Return where the parameters of the actor's tower begin: after mean_bias, value_bias and log_variance."""
    return shape.means + 1 + shape.free


@compiled
def critic_begin(shape: NetworkShape) -> int:
    """Return where the parameters of the critic's tower begin, if it has one of its own: after the actor's."""
    return actor_begin(shape) + tower_size(shape, shape.columns)


class ForwardCache(NamedTuple):
    """What a pass through a tower keeps for the backward pass: flat, layer after layer, each [n, width]."""

    values: Array  # the outputs of hidden layers
    slopes: Array  # of their activations


@compiled
def forward(
    weights: Array, shape: NetworkShape, begin: int, outputs: int, features: Array, kept: ForwardCache
) -> Array:
    """Return the outputs of a tower's head, [n, outputs]. begin: of the tower's parameters in `weights`."""
    n, at = len(features), 0
    for index in range(1, len(shape.widths)):
        inputs, width = shape.widths[index - 1], shape.widths[index]
        value = matrix(kept.values, at, n, width)
        np.dot(features, matrix(weights, begin, width, inputs).T, value)
        begin += width * inputs
        activate(shape.activation, value, weights[begin : begin + width], matrix(kept.slopes, at, n, width))
        begin += width
        at += n * width
        features = value
    return np.dot(features, matrix(weights, begin, outputs, shape.widths[-1]).T)  # type: ignore[no-any-return]


@compiled
def backward(
    weights: Array,
    gradient: Array,
    shape: NetworkShape,
    begin: int,
    features: Array,
    kept: ForwardCache,
    d_outputs: Array,
    spare: Array,
) -> None:
    """Write the gradients of a tower's parameters, from d loss / d outputs [n, outputs] and what `forward` kept.

    spare [2, n x largest width]: overwritten.
    """
    n, outputs = d_outputs.shape
    widths = shape.widths
    begin, at = begin + tower_size(shape, outputs), n * hidden_width(shape)  # the ends; both move to the beginning
    d_values = d_outputs
    for back in range(len(widths)):
        index = len(widths) - 1 - back  # of the layer below the weights
        below, above = widths[index], d_values.shape[1]
        if back:
            begin -= above
            slope, d_bias = matrix(kept.slopes, at, n, above), gradient[begin : begin + above]
            d_bias[:] = 0.0
            for i in range(n):
                for j in range(above):
                    d_values[i, j] *= slope[i, j]
                    d_bias[j] += d_values[i, j]
        begin -= above * below
        at -= n * below if index else 0
        values = matrix(kept.values, at, n, below) if index else features
        np.dot(d_values.T, values, matrix(gradient, begin, above, below))
        if index:
            d_below = matrix(spare[back % 2], 0, n, below)
            np.dot(d_values, matrix(weights, begin, above, below), d_below)
            d_values = d_below


@compiled
def tower_outputs(weights: Array, shape: NetworkShape, begin: int, outputs: int, features: Array) -> Array:
    """Return the outputs of a tower's head, [n, outputs]."""
    size = len(features) * hidden_width(shape)
    kept = ForwardCache(np.empty(size, np.float32), np.empty(size, np.float32))
    return forward(weights, shape, begin, outputs, features, kept)


@compiled
def heads(weights: Array, shape: NetworkShape, observations: Array) -> tuple[Array, Array]:
    """Return what `Network.heads` does: the actor's outputs [n, columns], and the values [n]."""
    outputs = tower_outputs(weights, shape, actor_begin(shape), shape.columns, observations)
    if shape.shared:
        values = outputs[:, -1] + weights[shape.means]
    else:
        values = tower_outputs(weights, shape, critic_begin(shape), 1, observations)[:, -1] + weights[shape.means]
    if len(shape.sums):
        outputs = np.dot(outputs, shape.sums)
    return outputs, values
