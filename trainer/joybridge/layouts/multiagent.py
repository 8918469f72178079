"""The layout `multiagent`: two policies that share a device."""

from joybridge.config.errors import SettingError
from joybridge.layouts.bucket import coarse, exclusive_buttons
from joybridge.layouts.hybrid import ranges
from joybridge.layouts.layout import Layout, together
from joybridge.v1 import bridge_pb2 as pb


def multiagent(device: pb.Device, setting: str = "") -> dict[str, Layout]:
    """Two policies that act together: "axes" as in hybrid, and "buttons", of which at most one is pressed.

    (Paper, section IV-C.) A device without axes or without buttons leaves one policy.
    """
    if setting:
        raise SettingError("expected multiagent")
    parts = {"axes": together(Layout(ranges(device)), coarse(device)), "buttons": exclusive_buttons(device)}
    return {name: layout for name, layout in parts.items() if layout.continuous or layout.discrete}
