"""The autoregressive layouts `auto-N` and `auto-axes-N`: buttons or axes first, then the others given these."""

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import product

from joybridge.config.errors import DeviceError
from joybridge.contract.tensors import Array
from joybridge.layouts.bucket import Spacing, bucket, coarse, exclusive_buttons
from joybridge.layouts.joint import in_words
from joybridge.layouts.layout import Layout, together
from joybridge.layouts.targets import AxisTable, JointTable
from joybridge.v1 import bridge_pb2 as pb

AXES_FIRST = "axes-"
MOST_GIVEN = 200  # combinations of values of all axes; each is a branch of the policy


def auto(device: pb.Device, setting: str) -> Layout:
    """As bucket-N, but each axis has a distribution of its own for every choice of the buttons.

    `auto-axes-N`: the axes are chosen first, and the buttons have a distribution for every combination of their values.
    """
    axes_first = setting.startswith(AXES_FIRST)
    setting = setting.removeprefix(AXES_FIRST)
    space = Spacing("auto-axes" if axes_first else "auto", setting)
    buttons = exclusive_buttons(device)
    if not buttons.discrete or not device.axes:
        return bucket(device, setting)
    (pressed,) = buttons.discrete
    assert isinstance(pressed, JointTable)
    values = [space(axis) for axis in device.axes]
    if axes_first:
        return together(_axes_first(values, pressed), coarse(device))
    axes = [
        AxisTable(index, own, given=((0, choice),))
        for index, own in enumerate(values)
        for choice in range(len(pressed.values))
    ]
    return together(Layout(discrete=(pressed, *axes)), coarse(device))


def _axes_first(values: Sequence[Array], pressed: JointTable) -> Layout:
    """Return a branch for each axis, and one for the buttons for every combination of the choices of these branches."""
    sizes = [len(own) for own in values]
    if (count := math.prod(sizes)) > MOST_GIVEN:
        raise DeviceError(
            f"{in_words(count)} combinations of values of all axes, expected at most {MOST_GIVEN}; take a smaller N, "
            "or auto-N, which chooses the buttons first"
        )
    axes = [AxisTable(index, own) for index, own in enumerate(values)]
    buttons = [replace(pressed, given=tuple(enumerate(chosen))) for chosen in product(*map(range, sizes))]
    return Layout(discrete=(*axes, *buttons))
