"""A layout: the mapping between one policy's actions and the part of a device that it covers.

A policy's action is a float array `continuous` [lanes, continuous] of unbounded samples and an int array
`discrete` [lanes, branches]. Continuous samples act clipped to ±3 and divided by 3, as in the original.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from joybridge.contract.codec import ActArrays
from joybridge.contract.tensors import Array
from joybridge.layouts.reading import read_continuous, read_discrete
from joybridge.layouts.targets import AxisRange, AxisTable, JointTable, Map, Part, Split, Threshold, covers
from joybridge.v1 import bridge_pb2 as pb

CLIP = 3.0  # samples beyond ±CLIP act like ±CLIP
GAUSSIAN = "joybridge.ppo.continuous.gaussian:Gaussian"  # beside other distributions
SQUASHED = "joybridge.ppo.continuous.squashed:Squashed"
GSDE = "joybridge.ppo.continuous.gsde:GSDE"  # followed by for how many decisions noise is kept


@dataclass(frozen=True)
class ActionSpace:
    """What a policy outputs: a number of continuous actions and the sizes of its categorical branches."""

    continuous: int
    branches: tuple[int, ...]
    ordinal: tuple[int, ...] = ()  # branches whose choices are neighbors, by their indices
    distributions: tuple[str, ...] = ()  # of each continuous action; (): all are Gaussians
    maps: tuple[tuple[int, Map], ...] = ()  # branches, by their indices, whose choices are places in an image

    @property
    def widest(self) -> int:
        """Return the number of choices of the largest branch, 0 without branches."""
        return max(self.branches, default=0)

    def with_deviation(self, names: Sequence[str]) -> dict[str, str]:
        """Return the distributions of the continuous actions that have a deviation, by what these act on.

        names: what all continuous actions act on.
        """
        kinds = [kind.partition("-")[0] for kind in self.distributions or (GAUSSIAN,) * self.continuous]
        return {name: kind for name, kind in zip(names, kinds, strict=True) if kind in (GAUSSIAN, SQUASHED, GSDE)}


@dataclass(frozen=True)
class Layout:
    """What each continuous action and each branch of a policy does to the device."""

    continuous: tuple[AxisRange | Threshold | Split, ...] = ()
    discrete: tuple[AxisTable | JointTable, ...] = ()

    @cached_property
    def space(self) -> ActionSpace:
        """Return the action space that this layout gives its policy."""
        tables = [*enumerate(self.discrete)]
        ordinal = tuple(index for index, table in tables if isinstance(table, AxisTable) and table.ordinal)
        maps = tuple((index, table.map) for index, table in tables if isinstance(table, JointTable) and table.map)
        sizes = tuple(len(table.values) for table in self.discrete)
        names = [target.distribution if isinstance(target, AxisRange) else "" for target in self.continuous]
        distributions = tuple(name or GAUSSIAN for name in names) if any(names) else ()
        return ActionSpace(len(self.continuous), sizes, ordinal, distributions, maps)

    def names(self, device: pb.Device) -> tuple[list[str], list[str]]:
        """Return what the policy's branches and its continuous actions act on: names of the device's parts."""
        return [_name(table, device) for table in self.discrete], [_name(part, device) for part in self.continuous]

    def write(
        self, continuous: Array, discrete: Array, act: ActArrays, device_masks: Sequence[Array] | None = None
    ) -> None:
        """Write the policy's actions into the columns of `act` that this layout covers.

        device_masks: what each branch of the device allows, bool [lanes, choices]. Categorical policies never choose
        what is forbidden, unless everything is; a continuous action that would is given the first allowed choice.
        """
        share = np.clip(continuous, -CLIP, CLIP) / CLIP if self.continuous else continuous
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
            act.choices[:, target.branch] = _allowed(choices, target.branch, device_masks)
        for column, table in enumerate(self.discrete):
            choices = discrete[:, column]
            if isinstance(table, AxisTable):
                act.axes[:, table.axis] = table.values[choices]
                continue
            for branch, values in zip(table.branches, table.values.T, strict=True):
                act.choices[:, branch] = values[choices]
            if device_masks is not None:
                _free(table, act, device_masks)
            if table.positions is not None:
                for axis, places in zip(table.axes, table.positions.T, strict=True):
                    act.axes[:, axis] = places[choices]

    def read(self, act: ActArrays) -> tuple[Array, Array]:
        """Return the policy's actions that come nearest to what a device was given: the reverse of `write`.

        continuous, float32 [lanes, continuous], in the middle of what acts alike; discrete, int64 [lanes, branches].
        A layout that knows better overrides this; as part of a mixture it is read by this one.
        """
        lanes = len(act.axes)
        continuous = np.zeros((lanes, len(self.continuous)), np.float32)
        discrete = np.zeros((lanes, len(self.discrete)), np.int64)
        for column, part in enumerate(self.continuous):
            continuous[:, column] = CLIP * read_continuous(part, act)
        for column, table in enumerate(self.discrete):
            discrete[:, column] = read_discrete(table, act)
        return continuous, discrete

    def masks(self, device_masks: Sequence[Array]) -> list[Array]:
        """Return which choices of the policy's branches are allowed, bool [lanes, choices] each.

        A joint choice is allowed if all its parts are. Where none is, those are that have the fewest forbidden parts,
        in whose place `write` gives the device what it allows.
        """
        lanes = len(device_masks[0])
        masks: list[Array] = []
        for table in self.discrete:
            allowed = np.ones((lanes, len(table.values)), bool)
            if isinstance(table, JointTable):
                for branch, choices in zip(table.branches, table.values.T, strict=True):
                    allowed &= device_masks[branch][:, choices]
                if (stuck := ~allowed.any(axis=1)).any():
                    forbidden = _forbidden_parts(table, [mask[stuck] for mask in device_masks])
                    allowed[stuck] = forbidden == forbidden.min(axis=1, keepdims=True)
            masks.append(allowed)
        return masks


def together(*layouts: Layout) -> Layout:
    """Return one layout that covers what several cover."""
    continuous: list[AxisRange | Threshold | Split] = []
    discrete: list[AxisTable | JointTable] = []
    for layout in layouts:
        continuous += layout.continuous
        discrete += layout.discrete
    return Layout(tuple(continuous), tuple(discrete))


def _allowed(choices: Array, branch: int, device_masks: Sequence[Array] | None) -> Array:
    """Return the choices of a branch of the device, the first allowed one in place of a forbidden one."""
    if device_masks is None:
        return choices
    mask = device_masks[branch]
    return np.where(mask[np.arange(len(mask)), choices], choices, mask.argmax(axis=1))


def _forbidden_parts(table: JointTable, device_masks: Sequence[Array]) -> Array:
    """Return how many choices of each row are forbidden, int [lanes, rows]."""
    forbidden = np.zeros((len(device_masks[0]), len(table.values)), np.int64)
    for branch, choices in zip(table.branches, table.values.T, strict=True):
        forbidden += ~device_masks[branch][:, choices]
    return forbidden


def _free(table: JointTable, act: ActArrays, device_masks: Sequence[Array]) -> None:
    """Where no row of a table is allowed, give each of its branches the first choice that is, in place."""
    allowed = {branch: _allowed(act.choices[:, branch], branch, device_masks) for branch in table.branches}
    if any((choices != act.choices[:, branch]).any() for branch, choices in allowed.items()):
        stuck = _forbidden_parts(table, device_masks).all(axis=1)
        for branch, choices in allowed.items():
            act.choices[stuck, branch] = choices[stuck]


def _name(part: Part, device: pb.Device) -> str:
    axes, branches = covers(part)
    return "+".join([*(device.axes[axis].name for axis in axes), *(device.branches[index].name for index in branches)])
