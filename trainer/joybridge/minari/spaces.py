"""How spaces of Gymnasium fit the sensors and the device of a behavior.

The rules are those by which `joybridge serve --gym` makes a game of an environment: a Box is a sensor or axes, a
Discrete a branch, or a sensor that is 1 at the value and 0 elsewhere, and a Dict or Tuple is its parts. So a dataset
that was recorded in an environment fits the game that `serve --gym` makes of it.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from gymnasium import spaces

from joybridge.contract.codec import ActArrays
from joybridge.contract.tensors import NUMPY_TYPES, Array
from joybridge.contract.text import printable
from joybridge.demonstrations.episodes import exact
from joybridge.v1 import bridge_pb2 as pb

MASK = "action_mask"
MAX_SPACE_CHARS = 300  # characters of a space in an error
ROUNDING = 1e-6  # of the range of an axis: bounds and values in 64 bits may lie this far outside

NO_BRANCHES = (np.zeros(0, np.int64), np.zeros(0, np.int64))

Read = Callable[[Any], Array]


class Part(NamedTuple):
    """A part of a space that is no Dict and no Tuple."""

    name: str
    path: tuple[Any, ...]  # the keys that lead to it
    space: Any

    def __str__(self) -> str:
        """Return its name and its space."""
        return f"{self.name} {described(self.space)}"


class Unfit(ValueError):
    """Spaces that do not fit a behavior; the text says what came and what was expected."""


def parts(space: Any, name: str, path: tuple[Any, ...] = ()) -> Iterator[Part]:
    """Yield the parts of a space, named as `joybridge serve --gym` names sensors."""
    if isinstance(space, spaces.Dict):
        for key, part in space.items():
            yield from parts(part, f"{name}.{key}" if path else str(key), (*path, key))
    elif isinstance(space, spaces.Tuple):
        for index, part in enumerate(space):
            yield from parts(part, f"{name}[{index}]", (*path, index))
    else:
        yield Part(name, path, space)


def described(space: Any) -> str:
    """Return a space in words of limited length."""
    text = " ".join(printable(str(space)).split())
    return text if len(text) <= MAX_SPACE_CHARS else f"{text[:MAX_SPACE_CHARS]}…"


def sensor_readers(space: Any, behavior: pb.Behavior) -> list[Read]:
    """Return what reads each sensor from the observations of an episode, [decisions + 1, *shape]. Raises Unfit."""
    found = {part.name: part for part in parts(space, "observation") if part.path != (MASK,)}
    sensors = list(behavior.sensors)
    if len(found) == len(sensors) == 1:  # whatever it is called
        found = {sensors[0].name: next(iter(found.values()))}
    readers = [_reader(found[one.name], one) if one.name in found else None for one in sensors]
    if None in readers or len(found) != len(sensors):
        came = ", ".join(map(str, found.values())) or "nothing"
        wanted = ", ".join(f"{one.name} {list(one.shape)} {NUMPY_TYPES[one.dtype].name}" for one in sensors)
        raise Unfit(f"it observes {came}, expected the sensors {wanted}")
    return [read for read in readers if read is not None]


def act_reader(space: Any, device: pb.Device) -> Callable[[Any], ActArrays]:
    """Return what reads the actions of an episode, [decisions, …]. Raises Unfit.

    Where elements are called as the axes and branches are, names decide. Otherwise one Box is all axes, and one other
    part all branches, in their order.
    """
    found = list(parts(space, "action"))
    boxes = [part for part in found if isinstance(part.space, spaces.Box)]
    others = [part for part in found if not isinstance(part.space, spaces.Box)]
    low, high = (np.array([getattr(axis, bound) for axis in device.axes], np.float64) for bound in ("low", "high"))
    span = (high - low) * ROUNDING
    ends = [_flat([getattr(part.space, bound) for part in boxes], np.float64) for bound in ("low", "high")]
    counts, starts = (
        (_flat(one, np.int64) for one in zip(*map(_counts, others), strict=True)) if others else NO_BRANCHES
    )
    axes = _order(boxes, [axis.name for axis in device.axes])
    branches = _order(others, [branch.name for branch in device.branches])
    if (
        axes is None
        or branches is None
        or not all((np.abs(came[axes] - wanted) <= span).all() for came, wanted in zip(ends, (low, high), strict=True))
        or counts[branches].tolist() != [len(branch.choices) for branch in device.branches]
    ):
        own_axes = ", ".join(f"{axis.name} {axis.low:g}..{axis.high:g}" for axis in device.axes) or "none"
        own_branches = ", ".join(f"{one.name} with {len(one.choices)} choices" for one in device.branches) or "none"
        raise Unfit(f"its actions are {described(space)}, expected the axes {own_axes} and the branches {own_branches}")

    def read(actions: Any) -> ActArrays:
        values, chosen = _columns(actions, boxes), _columns(actions, others)
        rows = len(values if boxes else chosen)
        values = values[:, axes] if boxes else np.zeros((rows, 0))
        chosen = (chosen - starts)[:, branches] if others else np.zeros((rows, 0))
        inside = np.clip(values, low, high)
        near = np.where(np.abs(inside - values) <= span, inside, values)
        return ActArrays(near.astype(np.float32), exact(chosen, np.int32))

    return read


def _order(found: Sequence[Part], wanted: Sequence[str]) -> Sequence[int] | None:
    """Return the places of axes or branches among the elements of some parts, None if they are not the same."""
    names = [name for part in found for name in _elements(part)]
    if sorted(names) == sorted(wanted):
        return [names.index(name) for name in wanted]
    return range(len(names)) if len(found) <= 1 and len(names) == len(wanted) else None


def _elements(part: Part) -> list[str]:
    """Return a name for each element of a part, as `joybridge serve --gym` does."""
    shape = part.space.shape
    if np.prod(shape) == 1 and len(shape) <= 1:
        return [part.name]
    return [f"{part.name}[{','.join(map(str, index))}]" for index in np.ndindex(shape)]


def mask_reader(device: pb.Device) -> Callable[[Any, int], list[Array] | None]:
    """Return what splits the masks of an episode, [decisions + 1, choices], by branch. It raises ValueError."""
    counts = [len(branch.choices) for branch in device.branches]

    def read(mask: Any, rows: int) -> list[Array] | None:
        if mask is None or not counts:
            return None
        flags = np.asarray(mask)
        if flags.shape != (rows, sum(counts)):
            raise ValueError(f"{MASK} is {list(flags.shape)}, expected {[rows, sum(counts)]}, one flag per choice")
        return np.split(flags.astype(bool), np.cumsum(counts)[:-1], axis=1)

    return read


def _reader(part: Part, sensor: pb.Sensor) -> Read | None:
    """Return what reads a sensor from a part of an observation, None if it does not fit."""
    dtype, shape = NUMPY_TYPES[sensor.dtype], tuple(sensor.shape)

    def values(observations: Any) -> Array:
        array = _at(observations, part.path)
        return exact(array.reshape(len(array), *shape), dtype)

    def one_hot(observations: Any) -> Array:
        counts, starts = _counts(part)
        array = _at(observations, part.path)
        index = exact(array.reshape(len(array), -1) - starts, np.int64)
        if index.shape[1] != len(counts) or not ((index >= 0) & (index < counts)).all():
            raise ValueError(f"{part.name} lies outside of its space {described(part.space)}")
        rows = np.zeros((len(array), *shape), np.float32)
        np.put_along_axis(rows, index + np.cumsum(counts) - counts, 1.0, axis=1)
        return rows

    if isinstance(part.space, spaces.Discrete | spaces.MultiDiscrete):
        return one_hot if shape == (int(_counts(part)[0].sum()),) and dtype == np.float32 else None
    if isinstance(part.space, spaces.Box | spaces.MultiBinary) and (part.space.shape or (1,)) == shape:
        return values
    return None


def _counts(part: Part) -> tuple[Array, Array]:
    """Return how many values each element of a part has, and the first of each. Raises Unfit."""
    space = part.space
    if isinstance(space, spaces.Discrete | spaces.MultiDiscrete):
        counts = np.ravel(space.n if isinstance(space, spaces.Discrete) else space.nvec)
        return counts, np.ravel(space.start)
    if isinstance(space, spaces.MultiBinary):
        size = int(np.prod(space.shape))
        return np.full(size, 2), np.zeros(size, np.int64)
    raise Unfit(f"{part} is neither an axis nor a branch")


def _at(values: Any, path: Iterable[Any]) -> Array:
    for key in path:
        values = values[key]
    array: Array = np.asarray(values)
    return array


def _columns(actions: Any, found: Sequence[Part]) -> Array:
    """Return parts of the actions of an episode side by side, [decisions, numbers]."""
    arrays = [_at(actions, part.path) for part in found]
    return np.concatenate([one.reshape(len(one), -1) for one in arrays], axis=1) if arrays else np.zeros((0, 0))


def _flat(arrays: Sequence[Any], dtype: Any) -> Array:
    return np.concatenate([np.ravel(one) for one in arrays]).astype(dtype) if len(arrays) else np.zeros(0, dtype)
