"""The layouts `beta`, `squashed` and `gsde-N`: as hybrid, with another distribution than a Gaussian for every axis."""

import re

from joybridge.config.errors import SettingError
from joybridge.layouts.hybrid import hybrid, ranges
from joybridge.layouts.layout import GSDE, SQUASHED, Layout
from joybridge.v1 import bridge_pb2 as pb

MAX_HOLD = 1_000_000  # decisions


def beta(device: pb.Device, setting: str = "") -> Layout:
    """As hybrid, with a beta distribution for every axis (Chou, Maturana and Scherer 2017)."""
    return _hybrid("beta", "joybridge.ppo.continuous.beta:Beta", device, setting)


def squashed(device: pb.Device, setting: str = "") -> Layout:
    """As hybrid, with a Gaussian that tanh squashes for every axis (Haarnoja et al. 2018)."""
    return _hybrid("squashed", SQUASHED, device, setting)


def gsde(device: pb.Device, setting: str) -> Layout:
    """As hybrid, with noise that depends on the state, and is kept for N decisions (Raffin et al. 2021)."""
    if not re.fullmatch("[0-9]{1,7}", setting) or not 1 <= int(setting) <= MAX_HOLD:
        raise SettingError(f"expected gsde-N with N in 1..{MAX_HOLD}, the decisions that noise is kept for")
    return Layout(ranges(device, f"{GSDE}-{int(setting)}"), hybrid(device).discrete)


def _hybrid(kind: str, distribution: str, device: pb.Device, setting: str) -> Layout:
    if setting:
        raise SettingError(f"expected {kind}")
    return Layout(ranges(device, distribution), hybrid(device).discrete)
