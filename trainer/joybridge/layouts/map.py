"""The layout `map-WxH`: a place in an image as one choice among the cells of a map."""

import re

import numpy as np

from joybridge.config.errors import DeviceError, SettingError
from joybridge.contract.tensors import Array
from joybridge.layouts.bucket import MAX_CHOICES, coarse, exclusive_buttons
from joybridge.layouts.layout import Layout, together
from joybridge.layouts.targets import JointTable, Map
from joybridge.v1 import bridge_pb2 as pb

MIN_SIDE = 2


def point_map(device: pb.Device, setting: str) -> Layout:
    """Both axes of a pointer one branch: the cells of a map, W across and H down; buttons as in `bucket-N`.

    The first axis is positive to the right, the second upwards, unless they say that it is the other way. A cell of
    `map-WxH` is that part of their ranges, and of an image of the whole field. `map-WxH-relative` is for axes that move
    the pointer, and for an image with the pointer in its middle: the cells in the middle are rest, those at the edges
    are full deflection.
    """
    shape = _shape(setting)
    if (count := len(device.axes)) != 2:
        instead = (
            "give it two by their names, as in bucket-7, x=map-16x10, y=map-16x10" if count > 2 else "take bucket-N"
        )
        raise DeviceError(f"it sets two axes, to the right and upwards, and there are {count}; {instead}")
    across, up = device.axes
    columns, rows = _values(across, shape.width, shape), _values(up, shape.height, shape)
    columns = columns[::-1] if across.way == pb.WAY_LEFT else columns  # from left to right
    rows = rows if up.way == pb.WAY_DOWN else rows[::-1]  # from top to bottom
    positions = np.stack([np.tile(columns, shape.height), np.repeat(rows, shape.width)], axis=1)
    nothing = np.zeros((len(positions), 0), np.int32)
    cells = Layout(discrete=(JointTable((), nothing, (0, 1), positions, shape),))
    return together(cells, coarse(device), exclusive_buttons(device))


def _shape(setting: str) -> Map:
    """Return the map that "WxH" or "WxH-relative" stands for. Raises SettingError."""
    match = re.fullmatch(r"([0-9]{1,5})x([0-9]{1,5})(-relative)?", setting)
    width, height = (int(match[1]), int(match[2])) if match else (0, 0)
    if match is None or min(width, height) < MIN_SIDE or width * height > MAX_CHOICES:
        raise SettingError(
            f"expected map-WxH or map-WxH-relative, with W and H from {MIN_SIDE} and at most {MAX_CHOICES} cells"
        )
    return Map(height, width, match[3] is not None)


def _values(axis: pb.Axis, cells: int, shape: Map) -> Array:
    """Return the values of an axis that a row or column of cells stands for, float32 [cells], from low to high."""
    if shape.relative:
        return np.linspace(axis.low, axis.high, cells, dtype=np.float32)
    middles = axis.low + (axis.high - axis.low) * (np.arange(cells) + 0.5) / cells
    return np.clip(middles, axis.low, axis.high).astype(np.float32)
