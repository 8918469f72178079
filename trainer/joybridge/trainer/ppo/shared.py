"""One update by several learners: each takes the gradient of its own rows, and all of them get the sum.

Every learner shuffles alike, so a minibatch is the same as with one learner, and so is its gradient, apart from the
rounding of a sum. Which learner has which rows is fixed for an update; so a row is sent once, not once per epoch. The
shares of a minibatch therefore differ by chance.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Self

import torch
from torch import Tensor

from joybridge.contract.tensors import Array
from joybridge.trainer.ppo.loss import Batch
from joybridge.trainer.ppo.schedule import Coefficients
from joybridge.trainer.ppo.update import Learner


@dataclass
class Shard(Batch):
    """The rows of one learner in a batch, or in a minibatch, of which all learners have rows.

    Its length is that of the whole batch.
    """

    places: Tensor  # int64 [own rows], ascending: where they are in the whole batch
    total: int  # rows of the whole batch

    def own(self) -> Batch:
        """Return the rows of this learner alone."""
        return Batch(**{field.name: getattr(self, field.name) for field in fields(Batch)})

    def rows(self, index: Tensor) -> Self:
        """Return the rows of this learner among those of the whole batch at `index`, where each stands at most once."""
        where = torch.full((self.total,), -1)
        where[index] = torch.arange(len(index))
        places, order = where[self.places].sort()
        first = int((places < 0).sum())  # the rows before are not among them
        own = self.own().rows(order[first:])
        return type(self)(**vars(own), places=places[first:], total=len(index))

    def __len__(self) -> int:
        return self.total


def bounds(rows: int, learner: int, learners: int) -> tuple[int, int]:
    """Return the first row of one learner in a batch, and the first of the next one; shares differ by one at most."""
    return rows * learner // learners, rows * (learner + 1) // learners


def make_shard(own: Batch, begin: int, total: int) -> Shard:
    """Return the shard of a learner whose rows stand side by side in the batch, from `begin`."""
    return Shard(**vars(own), places=torch.arange(begin, begin + len(own)), total=total)


class SharedGradient:
    """Sets the gradient of a network on minibatches of shards; a `LossGradient` as `Learner` takes it."""

    def __init__(self, learner: Learner, add_up: Callable[[Tensor], None]) -> None:
        """Share out the gradient of `learner`. add_up: replaces a tensor by the sum of those of all learners."""
        self.gradient, self.weights, self.add_up = learner.gradient, learner.weights, add_up
        self.statistics = len(learner.statistics)
        self.computing = self.waiting = 0.0  # seconds so far

    def __call__(self, batch: Batch, rows: Tensor, coefficients: Coefficients) -> Array:
        """Set the gradient of the loss on some rows of the whole batch of a `Shard`; return the statistics.

        The loss and the statistics are means over rows, so a learner counts as much as it has rows.
        """
        assert isinstance(batch, Shard) and self.weights.grad is not None
        begin = time.perf_counter()
        own = batch.rows(rows).own()
        message = torch.zeros(len(self.weights) + self.statistics)
        if len(own):
            message[len(self.weights) :] = torch.from_numpy(self.gradient(own, torch.arange(len(own)), coefficients))
            message[: len(self.weights)] = self.weights.grad
            message *= len(own) / len(rows)
        computed = time.perf_counter()
        self.add_up(message)
        self.weights.grad.copy_(message[: len(self.weights)])
        self.computing += computed - begin
        self.waiting += time.perf_counter() - computed
        return message[len(self.weights) :].numpy()
