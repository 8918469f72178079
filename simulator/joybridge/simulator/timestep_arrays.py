"""The timesteps of an author's games as arrays, checked: a mistake in one raises an ArenaError that names its arena."""

from collections.abc import Collection, Iterable
from math import isfinite
from typing import Any, NamedTuple

import numpy as np

from joybridge.contract.tensors import NUMPY_TYPES, Array
from joybridge.simulator.batched_game import ArenaError, GameError
from joybridge.simulator.game import Action, TimeStep
from joybridge.v1 import bridge_pb2 as pb

Rows = list[tuple[int, TimeStep]]  # timesteps, each with the number of its arena


class SensorFormat(NamedTuple):
    """What the values of a sensor must be."""

    name: str
    where: str  # for errors
    dtype: Any
    shape: tuple[int, ...]


class BehaviorFormat:
    """The parts of a behavior's spec that every step needs, as plain Python: protobuf is slow to read."""

    def __init__(self, behavior: pb.Behavior, first_slot: int) -> None:
        """Read a behavior whose agents are those from `first_slot` on in the author's lists."""
        self.name, self.agents = behavior.name, behavior.agents_per_arena
        self.slots = range(first_slot, first_slot + self.agents)
        device = behavior.device
        self.actions = [*(axis.name for axis in device.axes), *(branch.name for branch in device.branches)]
        self.choices = {branch.name: len(branch.choices) for branch in device.branches}
        self.channels = {channel.name: index for index, channel in enumerate(behavior.channels)}
        self.metrics = [metric.name for metric in behavior.metrics]
        self.scripts = [script.name for script in behavior.scripts]
        self.sensors = [
            SensorFormat(
                sensor.name, f"{behavior.name}: sensor {sensor.name!r}", NUMPY_TYPES[sensor.dtype], tuple(sensor.shape)
            )
            for sensor in behavior.sensors
        ]


def observations(behavior: BehaviorFormat, timesteps: Rows) -> list[Array]:
    """Return the values of every sensor of a behavior, [rows, *shape] each."""
    columns = []
    for sensor in behavior.sensors:
        try:
            raw = np.array([timestep.observation[sensor.name] for _, timestep in timesteps])
            column = _cast(raw, sensor.dtype)
        except Exception:  # one of them is wrong
            column = np.empty(0)
        if column.shape != (len(timesteps), *sensor.shape):
            column = _column(sensor, timesteps)
        require_finite(sensor.where, column, timesteps)
        columns.append(column)
    return columns


def _column(sensor: SensorFormat, timesteps: Rows) -> Array:
    """Return the values of a sensor. Raises GameError, which names the arena of the first wrong one."""
    column = np.empty((len(timesteps), *sensor.shape), sensor.dtype)
    for row, (arena, timestep) in enumerate(timesteps):
        if sensor.name not in timestep.observation:
            raise ArenaError(arena, f"{sensor.where} is in the spec but not in the observation")
        value = timestep.observation[sensor.name]
        if np.shape(value) != sensor.shape:
            came, wanted = list(np.shape(value)), list(sensor.shape)
            raise ArenaError(arena, f"{sensor.where} has shape {came}, expected {wanted}")
        try:
            column[row] = _cast(np.asarray(value), sensor.dtype)
        except Exception as error:  # it is no number, or too large for the dtype
            raise ArenaError(arena, f"{sensor.where}: {type(error).__name__}: {error}") from error
    return column


def _cast(raw: Array, dtype: Any) -> Array:
    """Return values as a dtype. Raises ValueError where whole numbers or bools would not be what they were."""
    if raw.dtype == dtype:
        return raw
    with np.errstate(invalid="ignore"):
        values = raw.astype(dtype)
    if np.dtype(dtype).kind != "f" and not np.array_equal(values, raw):
        wrong = raw.reshape(-1)[(values != raw).reshape(-1).argmax()]
        raise ValueError(f"got {wrong!s} of {raw.dtype}, expected a value of {np.dtype(dtype).name}")
    return values


def masks(behavior: BehaviorFormat, timesteps: Rows) -> list[Array] | None:
    """Return which choices of every branch are possible, bool [rows, choices] each; None: all of all."""
    if not any(timestep.masks for _, timestep in timesteps):
        return None
    for arena, timestep in timesteps:
        try:
            _require_known(f"{behavior.name}: masked branch", timestep.masks, behavior.choices)
            for name, mask in timestep.masks.items():
                if len(mask) != behavior.choices[name] or not any(mask):
                    came, wanted = list(mask), f"{behavior.choices[name]} booleans that are not all false"
                    raise GameError(f"{behavior.name}: mask of {name!r} is {came}, expected {wanted}")
        except BaseException as error:
            raise arena_error(arena, error) from error
    return [
        np.array([timestep.masks.get(name, [True] * count) for _, timestep in timesteps], bool)
        for name, count in behavior.choices.items()
    ]


def metrics(behavior: BehaviorFormat, ends: Rows) -> Array | None:
    """Return the metrics of episodes that have ended, float32 [rows, metrics]; None: the behavior has none."""
    names = behavior.metrics
    values = np.empty((len(ends), len(names)), np.float32)
    for row, (arena, timestep) in enumerate(ends):
        try:
            _require_known(f"{behavior.name}: metric", timestep.metrics, names)
            values[row] = [timestep.metrics.get(name, 0.0) for name in names]
        except BaseException as error:
            raise arena_error(arena, error) from error
    require_finite(f"{behavior.name}: a metric of {names}", values, ends)
    return values if names else None


def arena_error(arena: int, error: BaseException) -> ArenaError:
    """Return what a game has raised with the number of its arena; a call of exit() is an error as well."""
    text = str(error) if isinstance(error, GameError) else f"{type(error).__name__}: {error}"
    return ArenaError(arena, text)


def _require_known(what: str, given: Iterable[str], known: Collection[str]) -> None:
    for name in given:
        if name not in known:
            raise unknown_name(what, name, known)


def unknown_name(what: str, name: object, known: Collection[str]) -> GameError:
    """Return that the spec has no such name."""
    return GameError(f"{what} {name!r} is not in the spec, which has {list(known)}")


def require_action(what: str, action: Action, behavior: BehaviorFormat, timestep: TimeStep) -> None:
    """Raise GameError unless an action names all of a device and presses what it has and the masks allow."""
    if set(action) != set(behavior.actions):
        raise GameError(f"{what} returned {action!r}, expected a value for each of {behavior.actions}")
    for branch, count in behavior.choices.items():
        choice = action[branch]
        if choice not in range(count) or not timestep.masks.get(branch, [True] * count)[int(choice)]:
            raise GameError(f"{what} chose {choice!r} of {branch!r}, expected one of {count} that is not masked")


def require_finite(what: str, rows: Array, timesteps: Rows) -> None:
    """Raise ArenaError if a row has a number that is not finite."""
    if rows.dtype.kind != "f" or isfinite(np.vdot(rows, rows)):  # a finite sum of squares: all are, see `Format`
        return
    if not np.isfinite(rows).all():
        row, *_ = np.argwhere(~np.isfinite(rows))[0]
        raise ArenaError(timesteps[row][0], f"{what} is {rows[row].tolist()}, expected finite numbers")
