"""The layout `ordinal-N`: buckets that know their order (Tang and Agrawal 2020)."""

from joybridge.layouts.bucket import Spacing, coarse, exclusive_buttons
from joybridge.layouts.layout import Layout, together
from joybridge.layouts.targets import AxisTable
from joybridge.v1 import bridge_pb2 as pb


def ordinal(device: pb.Device, setting: str) -> Layout:
    """As bucket-N, with an ordinal distribution over the values of each axis.

    With s = sigmoid(output), the logit of a value is the sum of log(s) of all outputs up to its own and of log(1 - s)
    of those beyond. So an output moves probability to all values from its own on, or away from them.
    """
    space = Spacing("ordinal", setting)
    axes = tuple(AxisTable(index, space(axis), ordinal=True) for index, axis in enumerate(device.axes))
    return together(Layout(discrete=axes), coarse(device), exclusive_buttons(device))
