"""The layout `joint-N`: one categorical choice over everything that the device can do."""

import math

import numpy as np

from joybridge.config.errors import DeviceError
from joybridge.layouts.bucket import MAX_CHOICES, Spacing
from joybridge.layouts.layout import Layout
from joybridge.layouts.targets import JointTable
from joybridge.v1 import bridge_pb2 as pb


def joint(device: pb.Device, setting: str) -> Layout:
    """One branch whose choices are all combinations of N values of each axis and of the choices of all branches.

    There are at most MAX_CHOICES of them; VPT has 8 641 of its buttons.
    """
    space = Spacing("joint", setting)
    sizes = [*(space.values for _ in device.axes), *(len(branch.choices) for branch in device.branches)]
    if (count := math.prod(sizes)) > MAX_CHOICES:
        raise DeviceError(
            f"{in_words(count)} joint choices, expected at most {MAX_CHOICES:,}; take a smaller N, or bucket-N, which "
            "chooses for each axis by itself"
        )
    rows = np.indices(sizes, np.int32).reshape(len(sizes), count).T
    axes = len(device.axes)
    positions = [space(axis)[column] for axis, column in zip(device.axes, rows.T[:axes], strict=True)]
    table = JointTable(
        tuple(range(len(device.branches))), np.ascontiguousarray(rows[:, axes:]), tuple(range(axes)),
        np.stack(positions, axis=1) if positions else None,
    )  # fmt: skip
    return Layout(discrete=(table,))


def in_words(count: int) -> str:
    """Return a number of any size in a few characters."""
    return f"{count:,}" if count < 10**12 else f"about 10^{math.log10(count):.0f}"
