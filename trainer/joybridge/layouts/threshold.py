"""The layout `threshold-T`: Gaussians only."""

from joybridge.config.errors import SettingError
from joybridge.layouts.hybrid import ranges
from joybridge.layouts.layout import Layout
from joybridge.layouts.targets import Split, Threshold
from joybridge.v1 import bridge_pb2 as pb


def threshold(device: pb.Device, setting: str) -> Layout:
    """Every axis and every button a Gaussian; a button is pressed if its action passes the threshold.

    A threshold of 0 presses on positive actions; any other on actions smaller in size than it, which keeps
    "pressed" around the middle (paper, section IV-A; the original's code has 0 this way round). A branch of more than
    two choices is treated like an axis, of which it is a coarse one.
    """
    value = _share(setting)
    clicks = tuple(
        Threshold(index, value) if len(branch.choices) == 2 else Split(index, len(branch.choices))
        for index, branch in enumerate(device.branches)
    )
    return Layout((*ranges(device), *clicks))


def _share(text: str) -> float:
    """Return a number in 0..1. Raises SettingError."""
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if not 0.0 <= value <= 1.0:
        raise SettingError("expected threshold-T with T in 0.0..1.0")
    return value
