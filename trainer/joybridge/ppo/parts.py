"""The gradient of the PPO loss by autograd, in threads: each of them takes a part of a minibatch.

PyTorch's own threads share each operation instead, and wait for each other after each. Operations of networks as small
as ours are so short that this takes more time.
"""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import torch
from torch import Tensor

from joybridge.contract.tensors import Array
from joybridge.ppo.loss import Batch, advantage_moments, ppo_loss
from joybridge.ppo.networks import Network, flatten_parameters
from joybridge.ppo.schedule import Coefficients


class GradientInParts:
    """Sets the gradient of a network without memory on minibatches; a `LossGradient` as `Learner` takes it."""

    def __init__(self, network: Network, threads: int) -> None:
        """Work on `network`. threads: also the number of parts, so that results do not depend on the machine."""
        self._network, self._threads = network, threads
        self._gradient = flatten_parameters(network).grad
        self._parameters = list(network.parameters())
        self._others = ThreadPoolExecutor(threads - 1, initializer=torch.set_num_threads, initargs=(1,))

    def __call__(self, batch: Batch, rows: Tensor, coefficients: Coefficients) -> Array:
        """Set the gradient of the loss on some rows of `batch`; return the statistics that `ppo_loss` returns."""
        if coefficients.normalize_minibatch:
            mean, deviation = advantage_moments(batch.advantages[rows])
            batch = replace(batch, advantages=(batch.advantages - mean) / deviation)
            coefficients = replace(coefficients, normalize_minibatch=False)
        first, *others = rows.tensor_split(min(self._threads, len(rows)))
        given = batch, coefficients, len(rows)
        computed = [self._others.submit(self._of_part, part, *given) for part in others]
        parts = [self._of_part(first, *given), *(each.result() for each in computed)]
        gradient, statistics = (torch.stack(each).sum(0) for each in zip(*parts, strict=True))
        assert self._gradient is not None
        self._gradient.copy_(gradient)
        return statistics.numpy()

    def _of_part(self, rows: Tensor, batch: Batch, coefficients: Coefficients, total: int) -> Sequence[Tensor]:
        """Return what some rows add to the gradient and the statistics of `total` rows: all of these are means."""
        loss, statistics = ppo_loss(self._network, batch.minibatch(rows), coefficients)
        share = len(rows) / total
        gradients = torch.autograd.grad(loss * share, self._parameters, materialize_grads=True)
        return torch.cat([each.reshape(-1) for each in gradients]), statistics * share
