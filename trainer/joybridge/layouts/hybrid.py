"""The layout `hybrid`: the device as it is."""

import numpy as np

from joybridge.config.errors import SettingError
from joybridge.layouts.layout import Layout
from joybridge.layouts.targets import AxisRange, JointTable
from joybridge.v1 import bridge_pb2 as pb


def hybrid(device: pb.Device, setting: str = "") -> Layout:
    """Every axis a Gaussian, every branch categorical."""
    if setting:
        raise SettingError("expected hybrid")
    branches = tuple(one_branch(index, branch) for index, branch in enumerate(device.branches))
    return Layout(ranges(device), branches)


def ranges(device: pb.Device, distribution: str = "") -> tuple[AxisRange, ...]:
    """Return a continuous action for every axis. distribution: see `AxisRange`."""
    return tuple(AxisRange(index, axis.low, axis.high, distribution) for index, axis in enumerate(device.axes))


def one_branch(index: int, branch: pb.Branch) -> JointTable:
    """Return a branch of the device as it is."""
    return JointTable((index,), np.arange(len(branch.choices), dtype=np.int32)[:, None])
