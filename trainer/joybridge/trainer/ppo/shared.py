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

    It is shuffled and cut as the whole batch would be, and its length is that of the whole batch.
    """

    places: Tensor  # int64 [own rows], ascending: where they are in the whole batch
    total: int  # rows of the whole batch

    def own(self) -> Batch:
        """Return the rows of this learner alone."""
        return Batch(**{field.name: getattr(self, field.name) for field in fields(Batch)})

    def rows(self, index: Tensor) -> Self:
        """Return the whole batch in the order `index`, a permutation."""
        where = torch.empty_like(index)
        where[index] = torch.arange(len(index))
        places, order = where[self.places].sort()
        return type(self)(**vars(self.own().rows(order)), places=places, total=self.total)

    def slice(self, start: int, end: int) -> Self:
        """Return the rows start .. end - 1 of the whole batch."""
        first, last = torch.searchsorted(self.places, torch.tensor([start, end])).tolist()
        return type(self)(
            **vars(self.own().slice(first, last)), places=self.places[first:last] - start, total=end - start
        )

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

    def __call__(self, batch: Batch, coefficients: Coefficients) -> Array:
        """Set the gradient of the loss on the whole minibatch of a `Shard`; return the statistics of all its rows.

        The loss and the statistics are means over rows, so a learner counts as much as it has rows.
        """
        assert isinstance(batch, Shard) and self.weights.grad is not None
        begin = time.perf_counter()
        own = batch.own()
        message = torch.zeros(len(self.weights) + self.statistics)
        if len(own):
            message[len(self.weights) :] = torch.from_numpy(self.gradient(own, coefficients))
            message[: len(self.weights)] = self.weights.grad
            message *= len(own) / len(batch)
        computed = time.perf_counter()
        self.add_up(message)
        self.weights.grad.copy_(message[: len(self.weights)])
        self.computing += computed - begin
        self.waiting += time.perf_counter() - computed
        return message[len(self.weights) :].numpy()
