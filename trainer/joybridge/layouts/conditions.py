"""Which parts of a policy's action count: some axes of a device count only with a choice (`Axis.only_with`)."""

import numpy as np

from joybridge.contract.tensors import Array
from joybridge.layouts.layout import Layout
from joybridge.layouts.targets import covers
from joybridge.v1 import bridge_pb2 as pb


def needed_choice(device: pb.Device, axis: int) -> tuple[int, int] | None:
    """Return the branch and the choice without which an axis does not count; None: it always counts."""
    condition = device.axes[axis].only_with
    for index, branch in enumerate(device.branches):
        if branch.name == condition.branch:
            return index, list(branch.choices).index(condition.choice)
    return None  # also for a part of a device that lacks the branch


class Conditions:
    """With which choices of a device the parts of an action count: the policy's branches, then its continuous actions.

    A part that sets only axes that do not count in a decision is without effect in it, whatever layout made it. False
    if all parts always count.
    """

    def __init__(self, layout: Layout, device: pb.Device) -> None:
        """Take the layout of a policy, and the whole device of its behavior."""
        parts = [*layout.discrete, *layout.continuous]
        self._parts = len(parts)
        self._needs: dict[int, list[tuple[int, int]]] = {}  # any of these choices makes a part count
        for index, part in enumerate(parts):
            axes, branches = covers(part)
            needs = [need for axis in axes if (need := needed_choice(device, axis)) is not None]
            if not branches and len(needs) == len(axes):
                self._needs[index] = needs

    def __bool__(self) -> bool:
        return bool(self._needs)

    def counts(self, choices: Array) -> Array:
        """Return which parts count, bool [lanes, parts]. choices int [lanes, branches]: those of the device."""
        counts = np.ones((len(choices), self._parts), bool)
        for part, needs in self._needs.items():
            counts[:, part] = np.any([choices[:, branch] == choice for branch, choice in needs], axis=0)
        return counts
