"""The Gaussian as one distribution among others, for layouts that mix it with them."""

import math

import torch
from torch import Tensor


class Gaussian:
    """A mean from the network, and a log-variance that does not depend on the observation."""

    outputs = 1
    parameters = 1

    def sample(self, outputs: Tensor, parameters: Tensor, noise: Tensor) -> Tensor:
        """Return mean + standard deviation x noise."""
        return outputs[0] + torch.exp(0.5 * parameters) * noise

    def log_prob(self, outputs: Tensor, parameters: Tensor, samples: Tensor) -> Tensor:
        """Return the log-density of each sample."""
        squares = (samples - outputs[0]).square() * torch.exp(-parameters)
        return -0.5 * (squares + parameters + math.log(2 * math.pi))

    def entropy(self, outputs: Tensor, parameters: Tensor) -> Tensor:
        """Return the entropy, which is the same in all rows."""
        return (0.5 * (math.log(2 * math.pi * math.e) + parameters)).expand(outputs.shape[1])
