"""Which parts of a policy's action count: some axes of a device count only with a choice (`Axis.only_with`).

A game among several may lack parts of the common device: what sets only these never counts in its lanes.
"""

from collections.abc import Collection, Sequence

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

    def __init__(
        self, layout: Layout, device: pb.Device, no_axes: Collection[int] = (), no_branches: Collection[int] = ()
    ) -> None:
        """Take the layout of a policy, and the whole device of its behavior.

        no_axes, no_branches: parts of the device, by their indices, that do nothing.
        """
        parts = [*layout.discrete, *layout.continuous]
        self._parts = len(parts)
        self._needs: dict[int, list[tuple[int, int]]] = {}  # any of these choices makes a part count
        for index, part in enumerate(parts):
            axes, branches = (
                [one for one in whole if one not in none]
                for whole, none in zip(covers(part), (no_axes, no_branches), strict=True)
            )
            needs = [need for axis in axes if (need := needed_choice(device, axis)) is not None]
            if not branches and len(needs) == len(axes):  # without any axis it never counts
                self._needs[index] = needs

    def __bool__(self) -> bool:
        return bool(self._needs)

    def counts(self, choices: Array) -> Array:
        """Return which parts count, bool [lanes, parts]. choices int [lanes, branches]: those of the device."""
        counts = np.ones((len(choices), self._parts), bool)
        for part, needs in self._needs.items():
            counts[:, part] = np.any([choices[:, branch] == choice for branch, choice in needs], axis=0)
        return counts


class ConditionsOfGames:
    """The conditions of several games, each of which is played in some lanes of one group."""

    def __init__(self, games: Sequence[Conditions], kinds: Array) -> None:
        """Take the conditions of each game, and which game each lane plays, int [lanes]."""
        self._lanes = [(conditions, np.flatnonzero(kinds == kind)) for kind, conditions in enumerate(games)]

    def counts(self, choices: Array) -> Array:
        """Return which parts count, bool [lanes, parts]. choices int [lanes, branches]: those of the device."""
        parts = [conditions.counts(choices[lanes]) for conditions, lanes in self._lanes]
        counts = np.empty((len(choices), parts[0].shape[1]), bool)
        for (_, lanes), part in zip(self._lanes, parts, strict=True):
            counts[lanes] = part
        return counts
