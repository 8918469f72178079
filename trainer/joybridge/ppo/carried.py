"""Decisions whose outcome comes after the rollout in which they were made, because their lanes wait.

The lane of a player that is out may wait for hundreds of decisions, and only then be told what being out costs. Such a
decision is carried into the rollout that holds its outcome, and is learned from there.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from joybridge.config.arrays import select
from joybridge.contract.tensors import Array


class Carried(NamedTuple):
    """What is known of such decisions, one of each lane."""

    lanes: Array  # ascending
    arrays: dict[str, Array]  # [lanes, …], by their names in the rollout
    images: Sequence[Array]  # uint8 [lanes, frame_stack, height, width, channels]: of each image, what they saw

    def of(self, which: Array) -> "Carried":
        """Return some of them, bool [lanes]."""
        arrays = {name: array[which] for name, array in self.arrays.items()}
        return Carried(self.lanes[which], arrays, [stacks[which] for stacks in self.images])

    def state(self) -> dict[str, Array]:
        """Return everything, for a checkpoint; nothing if no lane waits."""
        if not len(self.lanes):
            return {}
        images = {f"images.{i}": stacks for i, stacks in enumerate(self.images)}
        arrays = {f"arrays.{name}": array for name, array in self.arrays.items()}
        return {"lanes": self.lanes, **arrays, **images}


NOTHING = Carried(np.zeros(0, np.int64), {}, ())


def carried_from(state: dict[str, Array]) -> Carried:
    """Return what `Carried.state` returned."""
    if not state:
        return NOTHING
    images = select(state, "images.")
    return Carried(state["lanes"], select(state, "arrays."), [images[str(i)] for i in range(len(images))])


def together(one: Carried, other: Carried) -> Carried:
    """Return the decisions of both, whose lanes differ. Masks that one of them lacks are zeros."""
    if not len(one.lanes) or not len(other.lanes):
        return one if len(one.lanes) else other
    order = np.argsort(np.concatenate([one.lanes, other.lanes]))

    def joined(first: Array, second: Array) -> Array:
        array: Array = np.concatenate([first, second])[order]
        return array

    arrays = {}
    for name in {**one.arrays, **other.arrays}:
        known = one.arrays[name] if name in one.arrays else other.arrays[name]
        parts = [
            part.arrays.get(name, np.zeros((len(part.lanes), *known.shape[1:]), known.dtype)) for part in (one, other)
        ]
        arrays[name] = joined(*parts)
    images = [joined(*stacks) for stacks in zip(one.images, other.images, strict=True)]
    return Carried(joined(one.lanes, other.lanes), arrays, images)
