"""Action layouts: how a policy's action space maps to the device of a game, and back.

The paper compares such mappings. Each works on the device of any spec, knows no game, and is pure:

    hybrid        every axis a Gaussian, every branch categorical, one joint log-probability
    bucket-N      every axis a branch of N evenly spaced values; all buttons share one branch with "nothing"
    threshold-T   (next to come) every button a Gaussian that presses it by a threshold
    multiagent    (next to come) one policy per part of the device

A policy's action is a float array `continuous` [lanes, continuous] of unbounded samples and an int array
`discrete` [lanes, branches]. Continuous samples act clipped to ±3 and divided by 3, as in the original.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from joybridge.codec import ActArrays
from joybridge.tensors import Array
from joybridge.v1 import bridge_pb2 as pb

CLIP = 3.0  # samples beyond ±CLIP act like ±CLIP
NOTHING = "nothing"  # the choice of an exclusive group in which no button is pressed


class LayoutError(ValueError):
    """A layout that does not exist or does not fit a device; the text says what was wanted."""


@dataclass(frozen=True)
class ActionSpace:
    """What a policy outputs: a number of Gaussians and the sizes of its categorical branches."""

    continuous: int
    branches: tuple[int, ...]


@dataclass(frozen=True)
class AxisRange:
    """A continuous action that moves one axis over its whole range."""

    axis: int
    low: float
    high: float


@dataclass(frozen=True)
class AxisTable:
    """A branch whose choices are values of one axis."""

    axis: int
    values: Array  # float32 [choices]


@dataclass(frozen=True)
class BranchTable:
    """A branch whose choices are joint choices of some of the device's branches."""

    branches: tuple[int, ...]
    values: Array  # int32 [choices, branches]


@dataclass(frozen=True)
class Layout:
    """A mapping between one policy's action space and the part of the device that it covers."""

    continuous: tuple[AxisRange, ...] = ()
    discrete: tuple[AxisTable | BranchTable, ...] = ()
    labels: tuple[tuple[str, ...], ...] = field(default=())  # of the discrete choices, for people

    @property
    def space(self) -> ActionSpace:
        """Return the action space that this layout gives its policy."""
        return ActionSpace(len(self.continuous), tuple(len(table.values) for table in self.discrete))

    def write(self, continuous: Array, discrete: Array, act: ActArrays) -> None:
        """Write the policy's actions into the columns of `act` that this layout covers."""
        share = np.clip(continuous, -CLIP, CLIP) / CLIP
        for column, target in enumerate(self.continuous):
            middle, half = (target.low + target.high) / 2, (target.high - target.low) / 2
            act.axes[:, target.axis] = np.clip(middle + half * share[:, column], target.low, target.high)
        for column, table in enumerate(self.discrete):
            if isinstance(table, AxisTable):
                act.axes[:, table.axis] = table.values[discrete[:, column]]
            else:
                act.choices[:, table.branches] = table.values[discrete[:, column]]

    def masks(self, device_masks: Sequence[Array]) -> list[Array]:
        """Return which choices of the policy's branches are allowed, bool [lanes, choices] each.

        A joint choice is allowed if all its parts are.
        """
        lanes = len(device_masks[0])
        masks = []
        for table in self.discrete:
            allowed = np.ones((lanes, len(table.values)), bool)
            if isinstance(table, BranchTable):
                for branch, choices in zip(table.branches, table.values.T, strict=True):
                    allowed &= device_masks[branch][:, choices]
            masks.append(allowed)
        return masks


def make_layout(name: str, device: pb.Device) -> Layout:
    """Return the layout called `name` ("hybrid", "bucket-11", …) for a device. Raises LayoutError."""
    kind, _, setting = name.partition("-")
    if kind == "hybrid" and not setting:
        return hybrid(device)
    if kind == "bucket" and setting.isdigit() and int(setting) >= 2:
        return bucket(device, int(setting))
    raise LayoutError(f"unknown layout {name!r}, expected hybrid or bucket-N with N of at least 2")


def hybrid(device: pb.Device) -> Layout:
    """Every axis a Gaussian, every branch categorical: the device as it is."""
    axes = tuple(AxisRange(index, axis.low, axis.high) for index, axis in enumerate(device.axes))
    tables = tuple(_one_branch(index, branch) for index, branch in enumerate(device.branches))
    return Layout(axes, tables, tuple(tuple(branch.choices) for branch in device.branches))


def bucket(device: pb.Device, values: int) -> Layout:
    """Every axis a branch of evenly spaced values, ends included; all buttons share one branch.

    The shared branch lists the buttons in the device's order, then "nothing", so at most one is pressed at
    a time (paper, section IV-B). A branch with more than two choices stays a branch.
    """
    tables: list[AxisTable | BranchTable] = []
    labels = []
    for index, axis in enumerate(device.axes):
        spaced = np.linspace(axis.low, axis.high, values, dtype=np.float32)
        tables.append(AxisTable(index, spaced))
        labels.append(tuple(f"{value:g}" for value in spaced))
    for index, branch in enumerate(device.branches):
        if len(branch.choices) > 2:
            tables.append(_one_branch(index, branch))
            labels.append(tuple(branch.choices))
    buttons = [index for index, branch in enumerate(device.branches) if len(branch.choices) == 2]
    if buttons:
        pressed = np.vstack([np.eye(len(buttons)), np.zeros(len(buttons))]).astype(np.int32)
        tables.append(BranchTable(tuple(buttons), pressed))
        labels.append((*(device.branches[index].name for index in buttons), NOTHING))
    return Layout((), tuple(tables), tuple(labels))


def _one_branch(index: int, branch: pb.Branch) -> BranchTable:
    return BranchTable((index,), np.arange(len(branch.choices), dtype=np.int32)[:, None])
