"""Whether layouts set every axis and branch of a device once, and only to what it takes."""

from collections.abc import Iterator, Sequence

import numpy as np

from joybridge.config.errors import DeviceError
from joybridge.contract.tensors import Array
from joybridge.layouts.layout import Layout
from joybridge.layouts.targets import AxisRange, AxisTable, JointTable, Part, Split, Threshold, covers
from joybridge.v1 import bridge_pb2 as pb


def check_layouts(layouts: Sequence[Layout], device: pb.Device) -> None:
    """Raise DeviceError unless the layouts of all policies that share a device fit it."""
    parts: list[Part] = [part for layout in layouts for part in (*layout.continuous, *layout.discrete)]
    axes, branches = ([index for part in parts for index in covers(part)[kind]] for kind in (0, 1))
    _check_each_once("axis", [axis.name for axis in device.axes], axes)
    _check_each_once("branch", [branch.name for branch in device.branches], branches)
    for part in parts:
        _check_form(part)
        for name, values, low, high in _values(part, device):
            if not len(values) or not (low <= values.min() <= values.max() <= high):
                raise DeviceError(f"it sets {name!r} to {values.tolist()[:9]}, expected values in {low:g}..{high:g}")


def _check_each_once(kind: str, names: Sequence[str], held: Sequence[int]) -> None:
    if beyond := [index for index in held if not 0 <= index < len(names)]:
        raise DeviceError(f"it sets {kind} {beyond[0]} of a device with {len(names)}, counted from 0")
    for index, name in enumerate(names):
        if (count := held.count(index)) != 1:
            raise DeviceError(f"it sets {name!r} {count} times, expected once")


def _check_form(part: Part) -> None:
    """Raise DeviceError for a range without extent, and for a table whose columns do not belong together."""
    if isinstance(part, AxisRange) and not part.low < part.high:
        raise DeviceError(f"it has a range {part.low:g}..{part.high:g} of axis {part.axis}, expected low < high")
    if isinstance(part, JointTable):
        if not np.array_equal(part.values, np.floor(part.values)):
            raise DeviceError("it has a table of choices that are no whole numbers")
        rows = 0 if part.positions is None else len(part.positions)
        if rows != (len(part.values) if part.axes else 0):
            raise DeviceError(
                f"it has a table of {len(part.values)} rows for {len(part.axes)} axes with {rows} positions, expected "
                "positions where there are axes, one per row"
            )


def _values(part: Part, device: pb.Device) -> Iterator[tuple[str, Array, float, float]]:
    """Yield the name of each axis and branch that a part sets, its values, and the bounds that the device has."""
    axes: list[tuple[int, Array]] = []
    branches: list[tuple[int, Array]] = []
    match part:
        case AxisRange():
            axes = [(part.axis, np.array([part.low, part.high]))]
        case AxisTable():
            axes = [(part.axis, part.values)]
        case Threshold():
            branches = [(part.branch, np.array([0, 1]))]
        case Split():
            branches = [(part.branch, np.array([0, part.choices - 1]))]
        case JointTable():
            branches = list(zip(part.branches, part.values.T, strict=True))
            if part.positions is not None:
                axes = list(zip(part.axes, part.positions.T, strict=True))
    for index, values in axes:
        yield device.axes[index].name, values, device.axes[index].low, device.axes[index].high
    for index, values in branches:
        yield device.branches[index].name, values, 0, len(device.branches[index].choices) - 1
