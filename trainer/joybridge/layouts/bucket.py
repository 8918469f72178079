"""The layout `bucket-N`: every axis a branch of N values, and one button at a time."""

import re

import numpy as np

from joybridge.config.errors import SettingError
from joybridge.contract.tensors import Array
from joybridge.layouts.hybrid import one_branch
from joybridge.layouts.layout import Layout, together
from joybridge.layouts.targets import AxisTable, JointTable
from joybridge.v1 import bridge_pb2 as pb

MAX_CHOICES = 10_000  # values; each is an output of the network
MU = 10.0  # as in VPT (Baker et al. 2022): 11 values are 0, ±0.06, ±0.16, ±0.32, ±0.58 and ±1 of half the range


def bucket(device: pb.Device, setting: str) -> Layout:
    """Every axis a branch of N values, ends included; all buttons share one branch.

    The shared branch lists the buttons in the device's order, then "nothing", so at most one is pressed at
    a time (paper, section IV-B). A branch of more than two choices stays as it is. `bucket-N-mu`: the values are spaced
    by the μ-law, densely in the middle.
    """
    space = Spacing("bucket", setting)
    axes = Layout(discrete=tuple(AxisTable(index, space(axis)) for index, axis in enumerate(device.axes)))
    return together(axes, coarse(device), exclusive_buttons(device))


class Spacing:
    """The values of an axis that "N" or "N-mu" stands for: evenly spaced ones, or by the μ-law."""

    def __init__(self, kind: str, setting: str) -> None:
        """Read the setting of a layout of this kind. Raises SettingError."""
        match = re.fullmatch(r"([0-9]{1,9})(-mu)?", setting)
        if match is None or not 2 <= int(match[1]) <= MAX_CHOICES:
            raise SettingError(f"expected {kind}-N or {kind}-N-mu with N in 2..{MAX_CHOICES}")
        self.values, self.mu = int(match[1]), match[2] is not None

    def __call__(self, axis: pb.Axis) -> Array:
        """Return the values of an axis, float32 [values], from low to high."""
        if not self.mu:
            return np.linspace(axis.low, axis.high, self.values, dtype=np.float32)
        even = np.linspace(-1.0, 1.0, self.values)
        shares = np.sign(even) * ((1.0 + MU) ** np.abs(even) - 1.0) / MU
        values = (axis.low + axis.high) / 2 + (axis.high - axis.low) / 2 * shares
        return np.clip(values, axis.low, axis.high).astype(np.float32)


def coarse(device: pb.Device) -> Layout:
    """Return the branches of more than two choices, as they are."""
    return Layout(
        discrete=tuple(
            one_branch(index, branch) for index, branch in enumerate(device.branches) if len(branch.choices) > 2
        )
    )


def exclusive_buttons(device: pb.Device) -> Layout:
    """Return one branch that presses one of the buttons or none."""
    buttons = [index for index, branch in enumerate(device.branches) if len(branch.choices) == 2]
    if not buttons:
        return Layout()
    pressed = np.vstack([np.eye(len(buttons)), np.zeros(len(buttons))]).astype(np.int32)
    return Layout(discrete=(JointTable(tuple(buttons), pressed),))
