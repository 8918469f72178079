"""A step of Adam, compiled: PyTorch takes longer to start its own than to compute it for a network of this size."""

import math

import numpy as np

from joybridge.contract.tensors import Array
from joybridge.ppo.fast.kernels import compiled


@compiled
def adam_step(
    weights: Array,
    gradient: Array,
    exp_avg: Array,
    exp_avg_sq: Array,
    step: float,
    learning_rate: float,
    beta1: float,
    beta2: float,
    epsilon: float,
) -> None:
    """Move the weights against their gradient (Kingma and Ba, 2015, algorithm 1), all float32 [parameters].

    step: how many steps there are with this one.
    """
    size = np.float32(learning_rate / (1.0 - beta1**step))
    root = np.float32(math.sqrt(1.0 - beta2**step))
    keep, add = np.float32(beta2), np.float32(1.0 - beta2)
    toward, small = np.float32(1.0 - beta1), np.float32(epsilon)
    for i in range(len(weights)):
        exp_avg[i] += toward * (gradient[i] - exp_avg[i])
        exp_avg_sq[i] = keep * exp_avg_sq[i] + add * gradient[i] * gradient[i]
        weights[i] -= size * exp_avg[i] / (np.sqrt(exp_avg_sq[i]) / root + small)
