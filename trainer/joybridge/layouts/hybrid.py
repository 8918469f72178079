"""The layout `hybrid`: the device as it is."""

from dataclasses import replace

import numpy as np

from joybridge.config.errors import SettingError
from joybridge.layouts.layout import Layout
from joybridge.layouts.targets import AxisRange, Given, JointTable
from joybridge.v1 import bridge_pb2 as pb


def hybrid(device: pb.Device, setting: str = "") -> Layout:
    """Every axis a Gaussian, every branch categorical."""
    if setting:
        raise SettingError("expected hybrid")
    branches = tuple(one_branch(index, branch) for index, branch in enumerate(device.branches))
    return Layout(conditional_ranges(device), branches)


def conditional_ranges(device: pb.Device, distribution: str = "") -> tuple[AxisRange, ...]:
    """Return a continuous action for every axis, which counts as the axis does. distribution: see `AxisRange`."""
    return tuple(replace(each, distribution=distribution, given=needed(device, each.axis)) for each in ranges(device))


def needed(device: pb.Device, axis: int) -> Given:
    """Return the branch and the choice without which an axis does not count; () if it always does."""
    condition = device.axes[axis].only_with
    for index, branch in enumerate(device.branches):
        if branch.name == condition.branch:
            return ((index, list(branch.choices).index(condition.choice)),)
    return ()


def ranges(device: pb.Device) -> tuple[AxisRange, ...]:
    """Return a continuous action for every axis."""
    return tuple(AxisRange(index, axis.low, axis.high) for index, axis in enumerate(device.axes))


def one_branch(index: int, branch: pb.Branch) -> JointTable:
    """Return a branch of the device as it is."""
    return JointTable((index,), np.arange(len(branch.choices), dtype=np.int32)[:, None])
