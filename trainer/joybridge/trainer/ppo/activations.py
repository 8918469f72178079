"""The activations of hidden layers: as autograd takes them, and with their derivatives, for the closed form."""

from collections.abc import Callable
from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn import functional


class Activation(NamedTuple):
    """A function of the sums z of a layer, elementwise."""

    value: Callable[[Tensor], Tensor]
    with_slope: Callable[[Tensor], tuple[Tensor, Tensor]]  # also the derivative; z is overwritten


def _swish(z: Tensor) -> tuple[Tensor, Tensor]:
    gate = torch.sigmoid(z)
    value = z.mul_(gate)
    return value, torch.addcmul(gate, value, 1.0 - gate)  # gate + swish (1 - gate)


def _tanh(z: Tensor) -> tuple[Tensor, Tensor]:
    value = z.tanh_()
    return value, 1.0 - value.square()


def _relu(z: Tensor) -> tuple[Tensor, Tensor]:
    value = z.relu_()
    return value, (value > 0).to(value.dtype)


def _elu(z: Tensor) -> tuple[Tensor, Tensor]:
    value = functional.elu(z, inplace=True)  # z, or exp(z) - 1 where z is negative
    return value, value.clamp_max(0.0) + 1.0


ACTIVATIONS = {
    "swish": Activation(functional.silu, _swish),
    "tanh": Activation(torch.tanh, _tanh),
    "relu": Activation(torch.relu, _relu),
    "elu": Activation(functional.elu, _elu),
}
