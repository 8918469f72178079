"""The gradient of the PPO loss in closed form: what autograd would compute, without its bookkeeping.

Everything but the matrix products is a handful of small operations on preallocated tensors; a test holds
the result to autograd's within 1e-6. For a minibatch of n rows, with r the ratio and A the advantage:

    d loss / d log-probability  = -A r / n, or 0 where the clipped surrogate is the smaller
    d log-probability / d logit = 1[chosen] - p
    d entropy / d logit         = -p (log p + H), H the branch's entropy
    d log-probability / d mean  = (a - mean) / variance
    d loss / d value            = (V - R) / n, or 0 where the clipped value is the worse
"""

import math

import torch
from torch import Tensor

from trainer.networks import Network, Tower
from trainer.ppo import Batch, Coefficients

LOG_2_PI = math.log(2 * math.pi)


class ClosedFormGradient:
    """Sets a network's gradient on minibatches; a `Gradient` as `ppo.update` takes it."""

    def __init__(self, network: Network) -> None:
        """Work on `network`, whose parameters must have gradients to write to (see flatten_parameters)."""
        self.network = network
        self.actor = TowerPass(network.actor)
        self.critic = TowerPass(network.critic) if network.critic is not None else None

    @torch.no_grad()
    def __call__(self, batch: Batch, coefficients: Coefficients) -> Tensor:
        """Set the gradient of the loss on `batch`; return [policy loss, value loss, entropy]."""
        network, n = self.network, len(batch)
        outputs = self.actor.forward(batch.observations)
        slope = torch.empty_like(outputs)  # d loss / d outputs
        values = outputs if self.critic is None else self.critic.forward(batch.observations)
        branches, continuous = network.pad.numel(), network.space.continuous

        log_probs = -batch.log_probs
        entropy = torch.zeros(())
        if branches:
            logits = outputs[:, :branches].view(n, *network.pad.shape) + network.pad
            if batch.masks is not None:
                logits += batch.masks
            log_p = torch.log_softmax(logits, -1)
            p = log_p.exp()
            chosen = batch.discrete.unsqueeze(-1)
            log_probs += log_p.gather(-1, chosen).sum((-1, -2))
            branch_entropy = -(p * log_p).sum(-1, keepdim=True)
            entropy = branch_entropy.sum() / n
        if continuous:
            mean = outputs[:, branches : branches + continuous] + network.mean_bias
            apart = batch.continuous - mean
            precision = torch.exp(-network.log_variance)
            squares = apart.square() * precision
            log_probs -= 0.5 * (squares + network.log_variance + LOG_2_PI).sum(-1)
            entropy = entropy + 0.5 * (LOG_2_PI + 1.0 + network.log_variance).mean()

        ratio = log_probs.exp_()
        unclipped = ratio * batch.advantages
        clipped = ratio.clamp(1 - coefficients.clip, 1 + coefficients.clip).mul_(batch.advantages)
        surrogate = torch.minimum(unclipped, clipped)
        push = torch.where(unclipped <= clipped, unclipped, 0.0).mul_(-1.0 / n).unsqueeze(-1)
        if branches:
            steer = log_p.add_(branch_entropy).mul_(coefficients.entropy / n).sub_(push.unsqueeze(-1)).mul_(p)
            steer.scatter_add_(-1, chosen, push.unsqueeze(-1).expand_as(chosen))
            slope[:, :branches] = steer.view(n, branches)
        if continuous:
            slope_of_mean = slope[:, branches : branches + continuous]
            torch.mul(apart.mul_(precision), push, out=slope_of_mean)
            _into(network.mean_bias, slope_of_mean.sum(0))
            spread = (squares.sub_(1.0).mul_(push)).sum(0).mul_(0.5).sub_(0.5 * coefficients.entropy / continuous)
            _into(network.log_variance, spread)

        value = values[:, -1] + network.value_bias
        error = value - batch.returns
        moved = value - batch.values
        free = moved.abs() <= coefficients.clip
        moved.clamp_(-coefficients.clip, coefficients.clip)
        clipped_squares = moved.add_(batch.values).sub_(batch.returns).square_()
        squared = error.square()
        worst = torch.maximum(squared, clipped_squares)
        slope_of_value = torch.where(free.logical_or_(squared >= clipped_squares), error, 0.0).mul_(1.0 / n)
        _into(network.value_bias, slope_of_value.sum())
        if self.critic is None:
            slope[:, -1] = slope_of_value
        else:
            self.critic.backward(slope_of_value.unsqueeze(-1))
        self.actor.backward(slope)
        return torch.stack([-surrogate.mean(), worst.mean(), entropy])


class TowerPass:
    """Forward and backward pass of one tower, with its intermediate results kept between the two."""

    def __init__(self, tower: Tower) -> None:
        self.layers = [(layer.weight, layer.bias) for layer in tower.layers]
        self.head = tower.head.weight
        self.inputs: list[Tensor] = []  # of each layer, and of the head last
        self.slopes: list[Tensor] = []  # of each layer's activation

    def forward(self, features: Tensor) -> Tensor:
        """Return the head's outputs [n, outputs]."""
        self.inputs, self.slopes = [features], []
        for weight, bias in self.layers:
            z = torch.addmm(bias, features, weight.t())
            gate = torch.sigmoid(z)
            features = z.mul_(gate)
            # d swish / dz = gate + swish (1 - gate)
            self.slopes.append(torch.addcmul(gate, features, 1.0 - gate))
            self.inputs.append(features)
        return torch.mm(features, self.head.t())

    def backward(self, slope: Tensor) -> None:
        """Set the gradients of all parameters from d loss / d outputs [n, outputs]."""
        _product_into(self.head, slope, self.inputs[-1])
        slope = torch.mm(slope, self.head)
        for index in reversed(range(len(self.layers))):
            weight, bias = self.layers[index]
            slope.mul_(self.slopes[index])
            _product_into(weight, slope, self.inputs[index])
            _into(bias, slope.sum(0))
            if index:
                slope = torch.mm(slope, weight)


def _product_into(parameter: Tensor, slope: Tensor, features: Tensor) -> None:
    assert parameter.grad is not None
    torch.mm(slope.t(), features, out=parameter.grad)


def _into(parameter: Tensor, gradient: Tensor) -> None:
    assert parameter.grad is not None
    parameter.grad.copy_(gradient)
