"""The layouts `beta` and `squashed`: axes whose distributions have the bounds of the axis, so nothing is clipped."""

from joybridge.config.errors import SettingError
from joybridge.layouts.hybrid import hybrid, ranges
from joybridge.layouts.layout import SQUASHED, Layout
from joybridge.v1 import bridge_pb2 as pb


def beta(device: pb.Device, setting: str = "") -> Layout:
    """As hybrid, with a beta distribution for every axis (Chou, Maturana and Scherer 2017)."""
    return _hybrid("beta", "joybridge.ppo.continuous.beta:Beta", device, setting)


def squashed(device: pb.Device, setting: str = "") -> Layout:
    """As hybrid, with a Gaussian that tanh squashes for every axis (Haarnoja et al. 2018)."""
    return _hybrid("squashed", SQUASHED, device, setting)


def _hybrid(kind: str, distribution: str, device: pb.Device, setting: str) -> Layout:
    if setting:
        raise SettingError(f"expected {kind}")
    return Layout(ranges(device, distribution), hybrid(device).discrete)
