"""Dense networks on the processor, compiled by Numba: forward pass, backward pass and activations.

PyTorch takes longer to start operations on matrices of this size than to compute them, so a whole pass is one compiled
function. Its matrix products are those of BLAS. The readable reference is `ppo/networks.py`; tests hold these functions
to it.

Shapes: n rows. What the hidden layers of a tower keep for the backward pass is one flat array, layer after layer, each
[n, width].
"""

from typing import NamedTuple

import numpy as np
from torch import Tensor

from joybridge.contract.tensors import Array
from joybridge.trainer.ppo.activations import ACTIVATIONS
from joybridge.trainer.ppo.fast.kernels import compiled
from joybridge.trainer.ppo.networks import Network
from joybridge.trainer.ppo.networks import Tower as TorchTower

SWISH, TANH, RELU, ELU = (list(ACTIVATIONS).index(name) for name in ("swish", "tanh", "relu", "elu"))
NO_SUMS = np.zeros((0, 0), np.float32)


class Tower(NamedTuple):
    """The parameters of one tower, or where their gradients are written."""

    weights: tuple[Array, ...]  # of each hidden layer and, last, of the head, [outputs, inputs]
    biases: tuple[Array, ...]  # of each hidden layer


class Dense(NamedTuple):
    """The parameters of a network of dense layers, or where their gradients are written. It shares their memory."""

    actor: Tower
    critic: Tower  # the actor's once more where they share one
    value_bias: Array  # [1]


class Form(NamedTuple):
    """What is known about a network beside its parameters."""

    shared: bool  # whether actor and critic are one tower
    activation: int
    sums: Array  # see `Network`; NO_SUMS without ordinal branches


def dense(network: Network, *, gradients: bool = False) -> Dense:
    """Return the parameters of a network as arrays, or their gradients. They are valid until parameters move."""

    def array(parameter: Tensor) -> Array:
        tensor = parameter.grad if gradients else parameter.detach()
        assert tensor is not None
        return tensor.numpy()

    def arrays(tower: TorchTower) -> Tower:
        layers = tower.layers
        weights = [*(layer.weight for layer in layers), tower.head.weight]
        return Tower(tuple(map(array, weights)), tuple(array(layer.bias) for layer in layers))

    return Dense(arrays(network.actor), arrays(network.critic or network.actor), array(network.value_bias))


def form(network: Network) -> Form:
    """Return the form of a network of dense layers."""
    sums = NO_SUMS if network.sums is None else network.sums.numpy()
    return Form(network.critic is None, list(ACTIVATIONS.values()).index(network.actor.activation), sums)


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
def hidden_width(tower: Tower) -> int:
    """Return how many numbers the hidden layers of a tower keep per row."""
    width = 0
    for bias in tower.biases:
        width += len(bias)
    return width


@compiled
def layer(kept: Array, tower: Tower, index: int, n: int) -> Array:
    """Return the part of a flat array that belongs to one hidden layer, [n, width]."""
    begin = 0
    for before in range(index):
        begin += n * len(tower.biases[before])
    width = len(tower.biases[index])
    return kept[begin : begin + n * width].reshape((n, width))


@compiled
def forward(tower: Tower, activation: int, features: Array, values: Array, slopes: Array) -> Array:
    """Return the outputs of a tower's head, [n, outputs].

    The outputs of hidden layers and the slopes of their activations are written into `values` and `slopes`, flat.
    """
    n = len(features)
    for index in range(len(tower.biases)):
        value = layer(values, tower, index, n)
        np.dot(features, tower.weights[index].T, value)
        activate(activation, value, tower.biases[index], layer(slopes, tower, index, n))
        features = value
    return np.dot(features, tower.weights[len(tower.biases)].T)  # type: ignore[no-any-return]


@compiled
def backward(
    tower: Tower, gradient: Tower, features: Array, values: Array, slopes: Array, d_outputs: Array
) -> None:  # fmt: skip
    """Write the gradients of a tower's parameters, from d loss / d outputs [n, outputs] and what `forward` kept."""
    n, last = len(features), len(tower.biases)
    np.dot(d_outputs.T, layer(values, tower, last - 1, n) if last else features, gradient.weights[last])
    d_features = np.dot(d_outputs, tower.weights[last])
    for back in range(last):
        index = last - 1 - back
        slope, d_bias = layer(slopes, tower, index, n), gradient.biases[index]
        d_bias[:] = 0.0
        for i in range(n):
            for j in range(len(d_bias)):
                d_features[i, j] *= slope[i, j]
                d_bias[j] += d_features[i, j]
        np.dot(d_features.T, layer(values, tower, index - 1, n) if index else features, gradient.weights[index])
        if index:
            d_features = np.dot(d_features, tower.weights[index])


@compiled
def tower_outputs(tower: Tower, activation: int, features: Array) -> Array:
    """Return the outputs of a tower's head, [n, outputs]."""
    kept = len(features) * hidden_width(tower)
    return forward(tower, activation, features, np.empty(kept, np.float32), np.empty(kept, np.float32))


@compiled
def heads(network: Dense, form: Form, observations: Array) -> tuple[Array, Array]:
    """Return what `Network.heads` does: the actor's outputs [n, columns], and the values [n]."""
    outputs = tower_outputs(network.actor, form.activation, observations)
    if form.shared:
        values = outputs[:, -1] + network.value_bias[0]
    else:
        values = tower_outputs(network.critic, form.activation, observations)[:, -1] + network.value_bias[0]
    if len(form.sums):
        outputs = np.dot(outputs, form.sums)
    return outputs, values
