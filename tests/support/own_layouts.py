"""Layouts of another package, as its users have it: `offer` installs them, without pip."""

from pathlib import Path

import numpy as np

from joybridge.trainer.layouts import DeviceError, JointTable, Layout, SettingError
from joybridge.trainer.layouts.hybrid import hybrid

ENTRY_POINTS = """[joybridge.layouts]
compass = tests.support.own_layouts:compass
careless = tests.support.own_layouts:careless
missing = tests.support.own_layouts:nothing
hybrid = tests.support.own_layouts:careless
twice = tests.support.own_layouts:compass
"""


def offer(folder: Path, package: str, text: str) -> None:
    """Write what pip leaves of an installed package with these entry points into a folder of `sys.path`."""
    info = folder / f"{package}-1.0.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {package}\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(text)


def compass(device, setting):
    """Move the first two axes together, in one of N directions or not at all; the rest is as in hybrid."""
    if not setting.isdecimal():
        raise SettingError("expected compass-N with N directions")
    if len(device.axes) != 2:
        raise DeviceError(f"it has {len(device.axes)} axes, and a compass moves two")
    angles = np.arange(int(setting)) * 2 * np.pi / int(setting)
    shares = np.vstack([np.column_stack([np.cos(angles), np.sin(angles)]), [0, 0]])
    low, high = (np.array([getattr(axis, end) for axis in device.axes]) for end in ("low", "high"))
    positions = np.clip((low + high) / 2 + (high - low) / 2 * shares, low, high).astype(np.float32)
    both = JointTable((), np.zeros((len(shares), 0), np.int32), (0, 1), positions)
    return Layout(discrete=(both, *hybrid(device).discrete))


def careless(device, setting):
    """Do wrong what the setting says."""
    layout = hybrid(device)
    if setting == "forgets":
        return Layout(layout.continuous[1:], layout.discrete)
    if setting == "repeats":
        return Layout(layout.continuous * 2, layout.discrete)
    if setting == "overshoots":
        return Layout(discrete=(JointTable((0, 1), np.array([[0, 2]], np.int32), (0, 1), np.zeros((1, 2))),))
    return Layout(hybrid(device).continuous, (JointTable((0, 7), np.zeros((2, 2), np.int32)),))
