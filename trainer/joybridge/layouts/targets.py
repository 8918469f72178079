"""The parts of a layout: what one continuous action, or one branch, of a policy does to the device.

Axes and branches are named by their indices in the device.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, TypeAlias, TypeVar

from joybridge.contract.tensors import Array


@dataclass(frozen=True)
class AxisRange:
    """A continuous action that moves one axis over its whole range."""

    axis: int
    low: float
    high: float
    distribution: str = ""  # the name of a `Distribution` (ppo/continuous); "": a Gaussian


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
    ordinal: bool = False  # the values are neighbors: what makes one likelier makes those beyond it likelier as well


class Map(NamedTuple):
    """How the choices of a branch lie in an image: row after row, from the top left."""

    height: int  # cells
    width: int
    relative: bool  # to the pointer, which is in the middle of the image; else the image shows the whole field


@dataclass(frozen=True)
class JointTable:
    """A branch whose choices are joint choices of some of the device's branches, and joint values of some axes."""

    branches: tuple[int, ...]
    values: Array  # int32 [choices, branches]
    axes: tuple[int, ...] = ()
    positions: Array | None = None  # float32 [choices, axes]; None without axes
    map: Map | None = None  # where the choices lie in an image, if they are places


Part: TypeAlias = AxisRange | Threshold | Split | AxisTable | JointTable
P = TypeVar("P", bound=Part)


def covers(part: Part) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Return the axes and the branches of the device that a part sets."""
    match part:
        case AxisRange() | AxisTable():
            return (part.axis,), ()
        case Threshold() | Split():
            return (), (part.branch,)
        case JointTable():
            return part.axes, part.branches


def relocate(part: P, axes: Sequence[int], branches: Sequence[int]) -> P:
    """Return a part of a smaller device as a part of the whole one.

    axes, branches: where each axis and branch of the smaller device stands in the whole one.
    """
    moved: dict[str, Any]
    match part:
        case AxisRange() | AxisTable():
            moved = {"axis": axes[part.axis]}
        case Threshold() | Split():
            moved = {"branch": branches[part.branch]}
        case JointTable():
            moved = {"axes": tuple(axes[i] for i in part.axes), "branches": tuple(branches[i] for i in part.branches)}
    return replace(part, **moved)
