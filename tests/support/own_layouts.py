"""Layouts of another package, as its users have it: `offer` installs them, without pip."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch

from joybridge.layouts import AxisRange, DeviceError, JointTable, Layout, SettingError
from joybridge.layouts.hybrid import hybrid, ranges

ENTRY_POINTS = """[joybridge.layouts]
compass = tests.support.own_layouts:compass
laplace = tests.support.own_layouts:laplace
careless = tests.support.own_layouts:careless
missing = tests.support.own_layouts:nothing
hybrid = tests.support.own_layouts:careless
leaving = tests.support.own_layouts:leaving
twice = tests.support.own_layouts:compass
"""


def offer(folder: Path, package: str, text: str) -> None:
    """Write what pip leaves of an installed package with these entry points into a folder of `sys.path`."""
    info = folder / f"{package}-1.0.dist-info"
    info.mkdir(parents=True)
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {package}\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(text)


def leaving(device, setting):
    """Do what no layout may do."""
    if setting == "exit":
        raise SystemExit(0)
    if setting == "error":
        raise RuntimeError("\x1b[2J")
    return 7


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


def laplace(device, setting):
    """As hybrid, with a distribution of this package."""
    axes = [replace(axis, distribution="tests.support.own_layouts:Laplace") for axis in ranges(device)]
    return Layout(tuple(axes), hybrid(device).discrete)


class Laplace:
    """A mean from the network, and the logarithm of a scale."""

    outputs = 1
    parameters = 1

    def sample(self, outputs, parameters, noise):
        share = torch.special.ndtr(noise) - 0.5
        return outputs[0] - torch.exp(parameters) * share.sign() * torch.log1p(-2 * share.abs().clamp(max=0.4999999))

    def log_prob(self, outputs, parameters, samples):
        return -(samples - outputs[0]).abs() * torch.exp(-parameters) - parameters - math.log(2.0)

    def entropy(self, outputs, parameters):
        return (1 + math.log(2.0) + parameters).expand(outputs.shape[1])


def careless(device, setting):
    """Do wrong what the setting says."""
    layout = hybrid(device)
    if setting == "forgets":
        return Layout(layout.continuous[1:], layout.discrete)
    if setting == "repeats":
        return Layout(layout.continuous * 2, layout.discrete)
    if setting == "overshoots":
        return Layout(discrete=(JointTable((0, 1), np.array([[0, 2]], np.int32), (0, 1), np.zeros((1, 2))),))
    if setting == "inverts":
        return Layout((AxisRange(0, 1.0, -1.0), *layout.continuous[1:]), layout.discrete)
    if setting == "misses":
        return Layout(discrete=(JointTable((0, 1), np.zeros((2, 2), np.int32), (0, 1)),))
    return Layout(hybrid(device).continuous, (JointTable((0, 7), np.zeros((2, 2), np.int32)),))


def narrow(device, setting):
    """Move the first axis within a half of its range."""
    first, *others = ranges(device)
    return Layout((AxisRange(0, first.low, (first.low + first.high) / 2), *others), hybrid(device).discrete)
