"""Spaces of Gymnasium as parts of a spec: an observation space becomes sensors, an action space axes and branches.

An entry "action_mask" of an observation is no sensor: it says which choices are allowed. The table of all spaces is in
docs/your-environment.md.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from itertools import pairwise
from math import isfinite
from typing import Any

import numpy as np
from gymnasium import spaces

from joybridge.adapters.settings import AdapterError
from joybridge.contract.limits import MAX_PER_ELEMENT
from joybridge.contract.tensors import Array
from joybridge.simulator import Action, axis, branch, button, sensor
from joybridge.v1 import bridge_pb2 as pb

MASK = "action_mask"
PIXELS = 16  # of each side of an image, at least; what is smaller may be a table, as the 7 x 7 of MiniGrid
KNOWN = "Box, Discrete, MultiDiscrete, MultiBinary, and Dict and Tuple of these"


class AgentSpaces:
    """What one agent observes and does, and the conversion of both."""

    def __init__(self, observation_space: Any, action_space: Any) -> None:
        """Read the spaces of an agent. Raises AdapterError for what the contract cannot say."""
        self.sensors: list[pb.Sensor] = []
        self.axes: list[pb.Axis] = []
        self.branches: list[pb.Branch] = []
        self._readers: list[tuple[str, tuple[Any, ...], Callable[[Any], Array]]] = []  # name, path, conversion
        self._masked = isinstance(observation_space, spaces.Dict) and MASK in observation_space.spaces
        for name, path, part in _leaves(observation_space, "observation"):
            if path != (MASK,):
                self._add_sensor(name, path, part)
        self._action_space = action_space
        self.act: Callable[[Action], Any] = self._control(action_space, "action", root=True)

    def observe(self, observation: Any) -> dict[str, Array]:
        """Return the sensors of one observation, as copies."""
        return {name: read(_at(observation, path) if path else observation) for name, path, read in self._readers}

    def masks(self, observation: Any, info: Mapping[str, Any], further: Any = None) -> dict[str, Any]:
        """Return the allowed choices of each branch: from `info`, the observation or `further`; empty for all.

        A mask has one flag per choice, of all branches side by side or in the form of the action space.
        Raises ValueError for another number of flags.
        """
        given = info.get(MASK, observation[MASK] if self._masked else further)
        if given is None:
            return {}
        flags = np.array(list(_flags(given, self._action_space)), bool)
        ends = np.cumsum([0, *(len(one.choices) for one in self.branches)])
        if len(flags) != ends[-1]:
            raise ValueError(f"the action mask has {len(flags)} flags, expected {ends[-1]}, one per choice")
        return {
            one.name: flags[begin:end] for one, (begin, end) in zip(self.branches, pairwise(ends.tolist()), strict=True)
        }

    def _add_sensor(self, name: str, path: tuple[Any, ...], space: Any) -> None:
        read: Callable[[Any], Array]
        if 0 in (space.shape or ()):
            raise AdapterError(f"{name} has the shape {space.shape}, so no number; leave it out by a wrapper")
        if isinstance(space, spaces.Box):
            shape = space.shape or (1,)
            made = sensor(name, shape, _bounds(space.low, min), _bounds(space.high, max), dtype=_dtype(space.dtype))
            if _is_image(space):
                made.image.color = pb.COLOR_RGB if shape[2:] == (3,) else pb.COLOR_GRAY
            read = np.array if space.shape else lambda value: np.reshape(value, shape)
        elif isinstance(space, spaces.MultiBinary):
            made, read = sensor(name, space.shape, dtype=bool), np.array
        elif isinstance(space, spaces.Discrete | spaces.MultiDiscrete):
            counts = np.ravel(space.n if isinstance(space, spaces.Discrete) else space.nvec)
            made, read = sensor(name, [int(counts.sum())], 0, 1), _one_hot(name, counts, np.ravel(space.start))
        else:
            raise _cannot_say(name, space)
        self.sensors.append(made)
        self._readers.append((name, path, read))

    def _control(self, space: Any, name: str, *, root: bool = False) -> Callable[[Action], Any]:
        """Add the axes and branches of a space; return what makes its part of an action from values by name."""
        if isinstance(space, spaces.Dict):
            inner = {key: self._control(part, _child(name, key, root)) for key, part in space.items()}
            return lambda chosen: {key: part(chosen) for key, part in inner.items()}
        if isinstance(space, spaces.Tuple):
            parts = [self._control(part, f"{name}[{index}]") for index, part in enumerate(space)]
            return lambda chosen: tuple(part(chosen) for part in parts)
        if isinstance(space, spaces.Box):
            return self._control_box(space, name)
        if isinstance(space, spaces.Discrete):
            self.branches.append(branch(name, [str(space.start + index) for index in range(space.n)]))
            return lambda chosen: np.int64(chosen[name] + space.start)
        if isinstance(space, spaces.MultiDiscrete):
            names, starts = _elements(name, space.shape), np.ravel(space.start)
            for element, count, start in zip(names, np.ravel(space.nvec), starts, strict=True):
                self.branches.append(branch(element, [str(start + index) for index in range(count)]))
            return lambda chosen: _array(chosen, names, space) + space.start
        if isinstance(space, spaces.MultiBinary):
            names = _elements(name, space.shape)
            self.branches += map(button, names)
            return lambda chosen: _array(chosen, names, space)
        raise _cannot_say(name, space)

    def _control_box(self, space: Any, name: str) -> Callable[[Action], Any]:
        names = _elements(name, space.shape)
        for element, low, high in zip(names, np.ravel(space.low), np.ravel(space.high), strict=True):
            if not (isfinite(low) and isfinite(high)):
                raise AdapterError(
                    f"{element} lies in {low:g}..{high:g}, but an axis needs finite bounds; wrap the environment in "
                    "gymnasium.wrappers.RescaleAction or give its action space bounds"
                )
            self.axes.append(axis(element, float(low), float(high)))
        if space.dtype == np.float32:  # as axes are
            return lambda chosen: _array(chosen, names, space)
        # Clipped because an axis has 32 bits, and a bound of 64 bits may lie below its neighbor of 32.
        round_off = np.rint if np.issubdtype(space.dtype, np.integer) else np.asarray
        return lambda chosen: np.asarray(
            np.clip(round_off(_array(chosen, names, space, float)), space.low, space.high), space.dtype
        )


def _leaves(space: Any, name: str, path: tuple[Any, ...] = ()) -> Iterator[tuple[str, tuple[Any, ...], Any]]:
    """Yield the parts of a space that are no Dict or Tuple: the name, the keys that lead there, and the part."""
    if isinstance(space, spaces.Dict):
        for key, part in space.items():
            yield from _leaves(part, _child(name, key, not path), (*path, key))
    elif isinstance(space, spaces.Tuple):
        for index, part in enumerate(space):
            yield from _leaves(part, f"{name}[{index}]", (*path, index))
    else:
        yield name, path, space


def _child(name: str, key: object, root: bool) -> str:
    return str(key) if root else f"{name}.{key}"


def _at(observation: Any, path: Iterable[Any]) -> Any:
    for key in path:
        try:
            observation = observation[key]
        except (LookupError, TypeError) as error:
            raise ValueError(f"the observation has no {key!r}, which its space has") from error
    return observation


def _elements(name: str, shape: tuple[int, ...]) -> list[str]:
    """Return a name for each element of an array, row-major."""
    if np.prod(shape) == 1 and len(shape) <= 1:
        return [name]
    return [f"{name}[{','.join(map(str, index))}]" for index in np.ndindex(shape)]


def _array(chosen: Action, names: list[str], space: Any, dtype: Any = None) -> Array:
    return np.array([chosen[name] for name in names], dtype or space.dtype).reshape(space.shape)


def _flags(mask: Any, space: Any) -> Iterator[Any]:
    """Yield the flags of a mask, in the order of the space."""
    if isinstance(mask, Mapping) and isinstance(space, spaces.Dict):
        for key, part in space.items():
            yield from _flags(mask.get(key), part)
    elif isinstance(mask, tuple | list):
        parts = space if isinstance(space, spaces.Tuple) and len(space) == len(mask) else [None] * len(mask)
        for flags, part in zip(mask, parts, strict=True):
            yield from _flags(flags, part)
    elif mask is not None:  # which is what the mask of a Box is
        yield from np.ravel(mask)


def _bounds(bounds: Array, widest: Callable[[Iterable[float]], float]) -> Array:
    """Return a bound per element in 32 bits, or one for all where they are equal or too many."""
    with np.errstate(over="ignore"):
        flat = np.ravel(bounds).astype(np.float32)
    equal = (flat == flat[:1]).all()
    return np.array([widest(flat)]) if equal or len(flat) > MAX_PER_ELEMENT else flat


def _dtype(dtype: Any) -> Any:
    """Return the type of a sensor that holds what a Box of a type does."""
    if dtype in (np.uint8, np.bool_):
        return dtype
    return np.int32 if dtype in (np.int8, np.int16, np.int32, np.uint16) else np.float32


def _is_image(space: spaces.Box) -> bool:
    """Return whether a Box is a picture, gray or RGB, and not a small table of numbers."""
    shape = space.shape
    return (
        space.dtype == np.uint8
        and (len(shape) == 2 or (len(shape) == 3 and shape[2] in (1, 3)))
        and min(shape[:2]) >= PIXELS
        and bool((space.low == 0).all() and (space.high == 255).all())
    )


def _one_hot(name: str, counts: Array, starts: Array) -> Callable[[Any], Array]:
    offsets = np.cumsum(counts) - counts

    def read(value: Any) -> Array:
        indices = np.ravel(value) - starts
        if indices.shape != counts.shape or not ((indices >= 0) & (indices < counts)).all():
            wanted = ", ".join(f"{start}..{start + count - 1}" for start, count in zip(starts, counts, strict=True))
            raise ValueError(f"{name} is {value}, expected {wanted}")
        row = np.zeros(counts.sum(), np.float32)
        row[offsets + indices] = 1.0
        return row

    return read


def _cannot_say(name: str, space: Any) -> AdapterError:
    return AdapterError(
        f"{name} is {type(space).__name__}, expected {KNOWN}; leave it out or convert it with a wrapper of Gymnasium"
    )
