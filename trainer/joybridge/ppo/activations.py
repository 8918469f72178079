"""The activations of hidden layers. `fast/towers.py` holds them compiled, with their derivatives."""

from collections.abc import Callable

import torch
from torch import Tensor
from torch.nn import functional

ACTIVATIONS: dict[str, Callable[[Tensor], Tensor]] = {
    "swish": functional.silu,
    "tanh": torch.tanh,
    "relu": torch.relu,
    "elu": functional.elu,
}
