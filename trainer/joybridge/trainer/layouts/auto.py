"""The layout `auto-N`: first the buttons, then the axes given the buttons (autoregressive)."""

from joybridge.trainer.layouts.bucket import Spacing, bucket, coarse, exclusive_buttons
from joybridge.trainer.layouts.layout import Layout, together
from joybridge.trainer.layouts.parts import AxisTable
from joybridge.v1 import bridge_pb2 as pb


def auto(device: pb.Device, setting: str) -> Layout:
    """As bucket-N, but each axis has a distribution of its own for every choice of the buttons."""
    space = Spacing("auto", setting)
    buttons = exclusive_buttons(device)
    if not buttons.discrete:
        return bucket(device, setting)
    (first,) = buttons.discrete
    axes = [
        AxisTable(index, space(axis), given=(0, choice))
        for index, axis in enumerate(device.axes)
        for choice in range(len(first.values))
    ]
    return together(Layout(discrete=(first, *axes)), coarse(device))
