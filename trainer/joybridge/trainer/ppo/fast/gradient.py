"""The gradient of the PPO loss in closed form: what autograd would compute, without its bookkeeping.

Matrix products are torch's; what lies between them is compiled (`kernels.py`). A test holds the result to
autograd's within 1e-6.
"""

import numpy as np
import torch
from torch import Tensor

from joybridge.contract.tensors import Array
from joybridge.trainer.ppo.fast.kernels import NO_MASKS, Action, Gradient, Head, Target, loss_gradient
from joybridge.trainer.ppo.loss import Batch
from joybridge.trainer.ppo.networks import Network, Tower
from joybridge.trainer.ppo.schedule import Coefficients


class ClosedFormGradient:
    """Sets the gradient of a network on minibatches; a `LossGradient` as `Learner` takes it."""

    def __init__(self, network: Network) -> None:
        """Work on `network`, whose parameters must have gradients to write to (see `flatten_parameters`)."""
        self.network = network
        self.actor = TowerPass(network.actor)
        self.critic = TowerPass(network.critic) if network.critic is not None else None
        sizes = np.array(network.space.branches, np.int64)
        self.head = Head(network.mean_bias.detach().numpy(), network.log_variance.detach().numpy(), sizes)

    @torch.no_grad()
    def __call__(self, batch: Batch, coefficients: Coefficients) -> Array:
        """Set the gradient of the loss on `batch`; return the statistics that `ppo_loss` returns."""
        network = self.network
        outputs = self.actor.forward(batch.observations)
        values = (outputs if self.critic is None else self.critic.forward(batch.observations))[:, -1]
        if network.sums is not None:
            outputs = torch.mm(outputs, network.sums)
        d_outputs, d_values = torch.empty_like(outputs), torch.empty(len(outputs))
        action = Action(batch.continuous.numpy(), batch.discrete.numpy(), batch.log_probs.numpy())
        statistics = loss_gradient(
            outputs.numpy(), (values + network.value_bias).numpy(), self.head,
            NO_MASKS if batch.masks is None else batch.masks.numpy(),
            Target(action, batch.values.numpy(), batch.advantages.numpy(), batch.returns.numpy()),
            coefficients.clip_range, coefficients.entropy_coef,
            Gradient(
                d_outputs.numpy(), d_values.numpy(), _gradient(network.mean_bias), _gradient(network.log_variance)
            ),
        )  # fmt: skip
        if self.critic is None:
            d_values = d_outputs[:, -1].copy_(d_values)
        _into(network.value_bias, d_values.sum())
        if self.critic is not None:
            self.critic.backward(d_values.unsqueeze(-1))
        self.actor.backward(d_outputs if network.sums is None else torch.mm(d_outputs, network.sums.t()))
        return statistics


class TowerPass:
    """Forward and backward pass of one tower, with its intermediate results kept between the two."""

    def __init__(self, tower: Tower) -> None:
        self.layers = [(layer.weight, layer.bias) for layer in tower.layers]
        self.activation = tower.activation.with_slope
        self.head = tower.head.weight
        self.inputs: list[Tensor] = []  # of each layer, and of the head last
        self.slopes: list[Tensor] = []  # derivative of each layer's activation

    def forward(self, features: Tensor) -> Tensor:
        """Return the outputs of the head [n, outputs]."""
        self.inputs, self.slopes = [features], []
        for weight, bias in self.layers:
            features, slope = self.activation(torch.addmm(bias, features, weight.t()))
            self.slopes.append(slope)
            self.inputs.append(features)
        return torch.mm(features, self.head.t())

    def backward(self, d_outputs: Tensor) -> None:
        """Set the gradients of all parameters from d loss / d outputs [n, outputs]."""
        _product_into(self.head, d_outputs, self.inputs[-1])
        d_features = torch.mm(d_outputs, self.head)
        for index in reversed(range(len(self.layers))):
            weight, bias = self.layers[index]
            d_features.mul_(self.slopes[index])
            _product_into(weight, d_features, self.inputs[index])
            _into(bias, d_features.sum(0))
            if index:
                d_features = torch.mm(d_features, weight)


def _gradient(parameter: Tensor) -> Array:
    """Return the gradient of a parameter as an array to write to."""
    assert parameter.grad is not None
    return parameter.grad.numpy()


def _product_into(parameter: Tensor, d_outputs: Tensor, features: Tensor) -> None:
    assert parameter.grad is not None
    torch.mm(d_outputs.t(), features, out=parameter.grad)


def _into(parameter: Tensor, gradient: Tensor) -> None:
    assert parameter.grad is not None
    parameter.grad.copy_(gradient)
