"""Action layouts: how a policy's action space maps to the device of a game, and back.

The paper compares such mappings. Each works on the device of any spec, knows no game, and is pure:

    hybrid        every axis a Gaussian, every branch categorical, one joint log-probability
    bucket-N      every axis a branch of N evenly spaced values; all buttons share one branch with "nothing"
    threshold-T   every axis and every button a Gaussian; a button is pressed by a threshold
    multiagent    two policies: one holds the axes, one the buttons

A button is a branch of two choices; a branch of more is treated like an axis, of which it is a coarse one.

A policy's action is a float array `continuous` [lanes, continuous] of unbounded samples and an int array
`discrete` [lanes, branches]. Continuous samples act clipped to ±3 and divided by 3, as in the original.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from joybridge.contract.codec import ActArrays, lane_count
from joybridge.contract.tensors import Array
from joybridge.trainer.errors import ConfigError
from joybridge.v1 import bridge_pb2 as pb

CLIP = 3.0  # samples beyond ±CLIP act like ±CLIP


@dataclass(frozen=True)
class ActionSpace:
    """What a policy outputs: a number of Gaussians and the sizes of its categorical branches."""

    continuous: int
    branches: tuple[int, ...]

    @property
    def widest(self) -> int:
        """Return the number of choices of the largest branch, 0 without branches."""
        return max(self.branches, default=0)


@dataclass(frozen=True)
class AxisRange:
    """A continuous action that moves one axis over its whole range."""

    axis: int
    low: float
    high: float


@dataclass(frozen=True)
class Threshold:
    """A continuous action that presses a button."""

    branch: int
    threshold: float  # 0: pressed if the action is positive; else: if its size is below the threshold


@dataclass(frozen=True)
class Split:
    """A continuous action whose range is split evenly among the choices of a branch."""

    branch: int
    choices: int


@dataclass(frozen=True)
class AxisTable:
    """A branch whose choices are values of one axis."""

    axis: int
    values: Array  # float32 [choices]


@dataclass(frozen=True)
class BranchTable:
    """A branch whose choices are joint choices of some of the device's branches."""

    branches: tuple[int, ...]
    values: Array  # int32 [choices, branches]


@dataclass(frozen=True)
class Layout:
    """A mapping between one policy's action space and the part of the device that it covers."""

    continuous: tuple[AxisRange | Threshold | Split, ...] = ()
    discrete: tuple[AxisTable | BranchTable, ...] = ()

    @property
    def space(self) -> ActionSpace:
        """Return the action space that this layout gives its policy."""
        return ActionSpace(len(self.continuous), tuple(len(table.values) for table in self.discrete))

    def names(self, device: pb.Device) -> tuple[list[str], list[str]]:
        """Return what the policy's branches and its Gaussians act on: names of the device's axes and branches."""
        branches = [
            device.axes[table.axis].name
            if isinstance(table, AxisTable)
            else "+".join(device.branches[branch].name for branch in table.branches)
            for table in self.discrete
        ]
        gaussians = [
            device.axes[target.axis].name if isinstance(target, AxisRange) else device.branches[target.branch].name
            for target in self.continuous
        ]
        return branches, gaussians

    def write(
        self, continuous: Array, discrete: Array, act: ActArrays, device_masks: Sequence[Array] | None = None
    ) -> None:
        """Write the policy's actions into the columns of `act` that this layout covers.

        device_masks: what each branch of the device allows, bool [lanes, choices]. Categorical policies
        never choose what is forbidden; a continuous action that would is given the first allowed choice.
        """
        share = np.clip(continuous, -CLIP, CLIP) / CLIP
        for column, target in enumerate(self.continuous):
            values = share[:, column]
            if isinstance(target, AxisRange):
                middle, half = (target.low + target.high) / 2, (target.high - target.low) / 2
                act.axes[:, target.axis] = np.clip(middle + half * values, target.low, target.high)
                continue
            if isinstance(target, Threshold):
                choices = (values > 0.0 if target.threshold == 0.0 else np.abs(values) < target.threshold).astype(int)
            else:
                choices = np.minimum(((values + 1) / 2 * target.choices).astype(int), target.choices - 1)
            if device_masks is not None:
                mask = device_masks[target.branch]
                choices = np.where(mask[np.arange(len(mask)), choices], choices, mask.argmax(axis=1))
            act.choices[:, target.branch] = choices
        for column, table in enumerate(self.discrete):
            if isinstance(table, AxisTable):
                act.axes[:, table.axis] = table.values[discrete[:, column]]
            else:
                act.choices[:, table.branches] = table.values[discrete[:, column]]

    def masks(self, device_masks: Sequence[Array]) -> list[Array]:
        """Return which choices of the policy's branches are allowed, bool [lanes, choices] each.

        A joint choice is allowed if all its parts are.
        """
        lanes = len(device_masks[0])
        masks = []
        for table in self.discrete:
            allowed = np.ones((lanes, len(table.values)), bool)
            if isinstance(table, BranchTable):
                for branch, choices in zip(table.branches, table.values.T, strict=True):
                    allowed &= device_masks[branch][:, choices]
            masks.append(allowed)
        return masks


def make_layouts(name: str, device: pb.Device) -> dict[str, Layout]:
    """Return the layouts called `name` ("hybrid", "bucket-11", "threshold-0.0", "multiagent") for a device.

    The keys name the part of the device that each of several policies holds; a single policy's is "".
    Raises ConfigError.
    """
    kind, _, setting = name.partition("-")
    if kind == "hybrid" and not setting:
        return {"": hybrid(device)}
    if kind == "multiagent" and not setting:
        return multiagent(device)
    if kind == "bucket" and setting.isdecimal() and int(setting) >= 2:
        return {"": bucket(device, int(setting))}
    if kind == "threshold" and (value := _share(setting)) is not None:
        return {"": threshold(device, value)}
    raise ConfigError(
        f"layout: unknown layout {name!r}, expected hybrid, multiagent, bucket-N with N of at least 2, "
        "or threshold-T with T in 0.0..1.0"
    )


class Role(NamedTuple):
    """What one policy plays: a behavior, or a part of its device."""

    name: str  # of the policy
    behavior: int  # index in the spec
    layout: Layout


def list_roles(layout: str, spec: pb.GameSpec) -> list[Role]:
    """Return the roles of all policies that play a game with a layout. Raises ConfigError."""
    return [
        Role(_policy_name(behavior.name, part, alone=len(spec.behaviors) == 1), index, made)
        for index, behavior in enumerate(spec.behaviors)
        for part, made in make_layouts(layout, behavior.device).items()
    ]


def _policy_name(behavior: str, part: str, *, alone: bool) -> str:
    """Return the name of the policy that holds `part` ("": all) of a behavior's device."""
    if not part:
        return behavior
    return part if alone else f"{behavior}-{part}"


def make_acts(spec: pb.GameSpec, arenas: int) -> list[ActArrays]:
    """Return arrays for the actions of all lanes, at rest: axes as near to 0 as they go, first choices."""
    acts = []
    for behavior in spec.behaviors:
        lanes, device = lane_count(behavior, arenas), behavior.device
        rest = np.array([min(max(0.0, axis.low), axis.high) for axis in device.axes], np.float32)
        acts.append(ActArrays(np.tile(rest, (lanes, 1)), np.zeros((lanes, len(device.branches)), np.int32)))
    return acts


def hybrid(device: pb.Device) -> Layout:
    """Every axis a Gaussian, every branch categorical: the device as it is."""
    tables = tuple(_one_branch(index, branch) for index, branch in enumerate(device.branches))
    return Layout(_ranges(device), tables)


def bucket(device: pb.Device, values: int) -> Layout:
    """Every axis a branch of evenly spaced values, ends included; all buttons share one branch.

    The shared branch lists the buttons in the device's order, then "nothing", so at most one is pressed at
    a time (paper, section IV-B).
    """
    spaced = [np.linspace(axis.low, axis.high, values, dtype=np.float32) for axis in device.axes]
    axes = tuple(AxisTable(index, column) for index, column in enumerate(spaced))
    return _together(Layout(discrete=axes), _coarse(device), _exclusive_buttons(device))


def threshold(device: pb.Device, value: float) -> Layout:
    """Every axis and every button a Gaussian; a button is pressed if its action passes the threshold.

    A threshold of 0 presses on positive actions; any other on actions smaller in size than it, which keeps
    "pressed" around the middle (paper, section IV-A; the original's code has 0 this way round).
    """
    clicks = tuple(
        Threshold(index, value) if len(branch.choices) == 2 else Split(index, len(branch.choices))
        for index, branch in enumerate(device.branches)
    )
    return Layout((*_ranges(device), *clicks))


def multiagent(device: pb.Device) -> dict[str, Layout]:
    """Two policies that act together: "axes" as in hybrid, and "buttons", of which at most one is pressed.

    (Paper, section IV-C.) A device without axes or without buttons leaves one policy.
    """
    parts = {"axes": _together(Layout(_ranges(device)), _coarse(device)), "buttons": _exclusive_buttons(device)}
    return {name: layout for name, layout in parts.items() if layout.continuous or layout.discrete}


def _ranges(device: pb.Device) -> tuple[AxisRange, ...]:
    return tuple(AxisRange(index, axis.low, axis.high) for index, axis in enumerate(device.axes))


def _coarse(device: pb.Device) -> Layout:
    """Return the branches of more than two choices, as they are."""
    return Layout(
        discrete=tuple(
            _one_branch(index, branch) for index, branch in enumerate(device.branches) if len(branch.choices) > 2
        )
    )


def _exclusive_buttons(device: pb.Device) -> Layout:
    """Return one branch that presses one of the buttons or none."""
    buttons = [index for index, branch in enumerate(device.branches) if len(branch.choices) == 2]
    if not buttons:
        return Layout()
    pressed = np.vstack([np.eye(len(buttons)), np.zeros(len(buttons))]).astype(np.int32)
    return Layout(discrete=(BranchTable(tuple(buttons), pressed),))


def _together(*layouts: Layout) -> Layout:
    """Return one layout that covers what several cover."""
    return Layout(
        tuple(target for layout in layouts for target in layout.continuous),
        tuple(table for layout in layouts for table in layout.discrete),
    )


def _one_branch(index: int, branch: pb.Branch) -> BranchTable:
    return BranchTable((index,), np.arange(len(branch.choices), dtype=np.int32)[:, None])


def _share(text: str) -> float | None:
    """Return a number in 0..1, or None."""
    try:
        value = float(text)
    except ValueError:
        return None
    return value if 0.0 <= value <= 1.0 else None
