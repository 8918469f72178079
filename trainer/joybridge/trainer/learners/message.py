"""What the trainer sends the other learners at each update: numbers, the weights with their moments, and their rows."""

from collections.abc import Sequence
from dataclasses import astuple
from typing import NamedTuple

import torch
from torch import Tensor

from joybridge.trainer.actor import Actor
from joybridge.trainer.errors import LearnerError
from joybridge.trainer.learners.group import Group
from joybridge.trainer.ppo.loss import Batch
from joybridge.trainer.ppo.schedule import Coefficients
from joybridge.trainer.ppo.shared import Shard, bounds, make_shard
from joybridge.trainer.ppo.update import Learner


class Replica(NamedTuple):
    """One policy at a learner other than the trainer."""

    actor: Actor
    learner: Learner
    most_rows: int  # of a batch


class Update(NamedTuple):
    """An update in which a learner takes part."""

    replica: Replica
    updates: int  # that were made before
    shard: Shard
    coefficients: Coefficients


def send_update(
    group: Group, policy: int, updates: int, learner: Learner, batch: Batch, coefficients: Coefficients
) -> Shard:
    """Send all other learners what they need for an update; return the rows of the trainer.

    policy: its place among the policies. updates: that were made before. The weights are sent each time, because nodes
    with other processors may round differently. Raises LearnerLost.
    """
    group.spread(_numbers(policy, updates, len(batch), batch.masks is not None, *astuple(coefficients)))
    group.spread(_pack(learner))
    parts = [batch.slice(*bounds(len(batch), number, group.count)) for number in range(group.count)]
    group.send([[tensor for tensor in vars(part).values() if tensor is not None] for part in parts[1:]])
    return make_shard(parts[0], 0, len(batch))


def receive_update(group: Group, replicas: Sequence[Replica]) -> Update:
    """Return what the trainer sends, and give the learner its weights. Raises LearnerLost and LearnerError."""
    group.spread(numbers := _numbers(*[0.0] * 7))
    policy, updates, rows, masked, *coefficients = numbers.tolist()
    if not (policy in range(len(replicas)) and updates >= 0 and 0 < rows <= replicas[int(policy)].most_rows):
        raise LearnerError(f"update {updates:g} of policy {policy:g} with {rows:g} rows is not of this run")
    replica = replicas[int(policy)]
    group.spread(packed := _pack(replica.learner))
    _unpack(packed, replica.learner)
    begin, end = bounds(int(rows), group.number, group.count)
    own = _empty_batch(replica.actor, end - begin, masked=bool(masked))
    group.receive([tensor for tensor in vars(own).values() if tensor is not None])
    return Update(replica, int(updates), make_shard(own, begin, int(rows)), Coefficients(*coefficients))


def _numbers(*numbers: float) -> Tensor:
    return torch.tensor(numbers, dtype=torch.float64)


def _pack(learner: Learner) -> Tensor:
    """Return weights and moments as one tensor."""
    return torch.cat([learner.weights.detach(), *(moment.reshape(-1) for moment in learner.moments.values())])


@torch.no_grad()
def _unpack(packed: Tensor, learner: Learner) -> None:
    """Take back what `_pack` returned."""
    begin = 0
    for tensor in (learner.weights, *learner.moments.values()):
        tensor.copy_(packed[begin : begin + tensor.numel()].view_as(tensor))
        begin += tensor.numel()


def _empty_batch(actor: Actor, rows: int, *, masked: bool) -> Batch:
    space = actor.layout.space
    return Batch(
        observations=torch.empty(rows, actor.observation_size),
        continuous=torch.empty(rows, space.continuous),
        discrete=torch.empty(rows, len(space.branches), dtype=torch.int64),
        masks=torch.empty(rows, len(space.branches), space.widest) if masked else None,
        log_probs=torch.empty(rows), values=torch.empty(rows), advantages=torch.empty(rows), returns=torch.empty(rows),
    )  # fmt: skip
