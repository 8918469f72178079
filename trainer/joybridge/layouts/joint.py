"""The layout `joint-N`: one categorical choice over everything that the device can do."""

import math
from collections.abc import Iterator
from itertools import product

import numpy as np

from joybridge.config.errors import DeviceError
from joybridge.contract.tensors import Array
from joybridge.layouts.bucket import MAX_CHOICES, Spacing
from joybridge.layouts.conditions import needed_choice
from joybridge.layouts.layout import Layout
from joybridge.layouts.targets import JointTable
from joybridge.v1 import bridge_pb2 as pb

UNUSED = -1  # index of the value of an axis that does not count


def joint(device: pb.Device, setting: str) -> Layout:
    """One branch whose choices are all combinations of N values of each axis and of the choices of all branches.

    An axis that does not count with the choices of the branches is in the middle. There are at most MAX_CHOICES
    combinations; VPT has 8 641 of its buttons.
    """
    space = Spacing("joint", setting)
    axes, branches = range(len(device.axes)), range(len(device.branches))
    combinations = math.prod(len(branch.choices) for branch in device.branches)
    if combinations <= MAX_CHOICES:
        combinations = sum(math.prod(sizes) for sizes, _ in _grids(device, space.values))
    if combinations > MAX_CHOICES:
        raise DeviceError(
            f"{in_words(combinations)} joint choices, expected at most {MAX_CHOICES:,}; take a smaller N, or bucket-N, "
            "which chooses for each axis by itself"
        )
    parts = [_rows(sizes, choices) for sizes, choices in _grids(device, space.values)]
    rows = np.unique(np.concatenate(parts), axis=0)  # sorted, so the order is that of the values of the axes
    positions = [_values(space, axis)[column] for axis, column in zip(device.axes, rows.T, strict=False)]
    table = JointTable(
        tuple(branches),
        np.ascontiguousarray(rows[:, len(axes) :]),
        tuple(axes),
        np.stack(positions, axis=1) if positions else None,
    )
    return Layout(discrete=(table,))


def _grids(device: pb.Device, values: int) -> Iterator[tuple[list[int], tuple[int, ...]]]:
    """Yield how many values each axis has with each combination of the choices of all branches, and these choices.

    An axis that does not count has 1.
    """
    needs = [needed_choice(device, axis) for axis in range(len(device.axes))]
    for choices in product(*(range(len(branch.choices)) for branch in device.branches)):
        yield [values if need is None or choices[need[0]] == need[1] else 1 for need in needs], choices


def _rows(sizes: list[int], choices: tuple[int, ...]) -> Array:
    """Return all combinations of values of axes beside these choices, int32 [combinations, axes + branches].

    The only value of an axis that does not count is UNUSED.
    """
    grid = np.indices(sizes, np.int32).reshape(len(sizes), math.prod(sizes)).T
    grid = np.where(np.array(sizes) == 1, UNUSED, grid)
    return np.concatenate([grid, np.tile(np.array(choices, np.int32), (len(grid), 1))], axis=1)


def _values(space: Spacing, axis: pb.Axis) -> Array:
    """Return the values of an axis, the last of which, at UNUSED, is its middle."""
    return np.append(space(axis), np.float32((axis.low + axis.high) / 2))


def in_words(count: int) -> str:
    """Return a number of any size in a few characters."""
    return f"{count:,}" if count < 10**12 else f"about 10^{math.log10(count):.0f}"
