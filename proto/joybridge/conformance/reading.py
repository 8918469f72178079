"""Steps as arrays, read with patience: a tensor that is malformed is one check's business and no other's."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from math import prod

import numpy as np

from joybridge.conformance.registry import expect
from joybridge.contract.tensors import NUMPY_TYPES, Array
from joybridge.v1 import bridge_pb2 as pb


def misfit(tensor: pb.Tensor, dtype: pb.Dtype, shape: tuple[int, ...]) -> str:
    """Return what is wrong with the dtype, shape or length of a tensor, or nothing."""
    if tensor.dtype != dtype:
        return f"dtype {tensor.dtype}"
    if tuple(tensor.shape) != shape:
        return f"shape {list(tensor.shape)}"
    if len(tensor.data) != prod(shape) * NUMPY_TYPES[dtype].itemsize:
        return f"{len(tensor.data)} bytes of data"
    if dtype == pb.DTYPE_BOOL and tensor.data and max(tensor.data) > 1:
        return f"a boolean that is {max(tensor.data)}"
    return ""


def read(tensor: pb.Tensor, dtype: pb.Dtype, shape: tuple[int, ...]) -> Array | None:
    """Return the array in a tensor, NaN and all, or None if the tensor is malformed."""
    if dtype not in NUMPY_TYPES or misfit(tensor, dtype, shape):
        return None
    return np.frombuffer(tensor.data, NUMPY_TYPES[dtype]).reshape(shape)


def expect_fit(tensor: pb.Tensor, dtype: pb.Dtype, shape: tuple[int, ...], what: str) -> None:
    """Raise Broken unless a tensor has a dtype, a shape and the bytes of both."""
    wrong = misfit(tensor, dtype, shape)
    expect(not wrong, f"{what} with {wrong}", f"{pb.Dtype.Name(dtype)} {list(shape)}")


@dataclass(frozen=True)
class Part:
    """One behavior's part of a step and what it should look like."""

    message: pb.BehaviorStep
    behavior: pb.Behavior
    arenas: int
    where: str  # the behavior and the decision, for failures

    @property
    def lanes(self) -> int:
        """Return the number of rows."""
        return self.arenas * self.behavior.agents_per_arena

    @cached_property
    def terminated(self) -> Array | None:
        """Return which lanes terminated."""
        return read(self.message.terminated, pb.DTYPE_BOOL, (self.lanes,))

    @cached_property
    def truncated(self) -> Array | None:
        """Return which lanes were truncated."""
        return read(self.message.truncated, pb.DTYPE_BOOL, (self.lanes,))

    @cached_property
    def ended(self) -> Array:
        """Return which lanes ended by their flags, as far as these can be read."""
        none = np.zeros(self.lanes, bool)
        terminated, truncated = self.terminated, self.truncated
        return (none if terminated is None else terminated) | (none if truncated is None else truncated)

    @cached_property
    def deciding(self) -> Array:
        """Return which lanes decide next; all where nothing readable says otherwise."""
        deciding = (
            read(self.message.deciding, pb.DTYPE_BOOL, (self.lanes,)) if self.message.HasField("deciding") else None
        )
        return np.ones(self.lanes, bool) if deciding is None else deciding

    @property
    def rewards(self) -> Array | None:
        """Return what was earned, lanes by channels."""
        return read(self.message.rewards, pb.DTYPE_FLOAT32, (self.lanes, len(self.behavior.channels)))

    def allowed(self, branch: int) -> Array:
        """Return the allowed choices of a branch; all where no readable mask says otherwise."""
        count = len(self.behavior.device.branches[branch].choices)
        masks = self.message.masks
        mask = read(masks[branch], pb.DTYPE_BOOL, (self.lanes, count)) if branch < len(masks) else None
        return np.ones((self.lanes, count), bool) if mask is None else mask

    def sensed(self, final: bool = False) -> Iterator[tuple[pb.Sensor, Array]]:
        """Yield the readable observations, or the readable final ones, with their sensors."""
        tensors = self.message.ended.final_observations if final else self.message.observations
        rows = int(self.ended.sum()) if final else self.lanes
        for tensor, sensor in zip(tensors, self.behavior.sensors, strict=False):
            values = read(tensor, sensor.dtype, (rows, *sensor.shape))
            if values is not None:
                yield sensor, values


def parts_of(step: pb.Step, spec: pb.GameSpec, arenas: int, decision: int) -> list[Part]:
    """Return the parts of a step that belong to a behavior of the spec."""
    return [
        Part(message, behavior, arenas, f"{behavior.name} after {decision} decisions")
        for message, behavior in zip(step.behaviors, spec.behaviors, strict=False)
    ]


def expect_sensed(tensors: Sequence[pb.Tensor], part: Part, rows: int, what: str) -> None:
    """Raise Broken unless there is a tensor per sensor, with that many rows."""
    sensors = part.behavior.sensors
    expect(len(tensors) == len(sensors), f"{len(tensors)} {what} of {part.where}", f"{len(sensors)}, one per sensor")
    for tensor, sensor in zip(tensors, sensors, strict=True):
        expect_fit(tensor, sensor.dtype, (rows, *sensor.shape), f"{what} of sensor {sensor.name!r} of {part.where}")


def expect_finite(part: Part, final: bool = False) -> None:
    """Raise Broken if an observation is NaN or infinite."""
    for sensor, values in part.sensed(final):
        if sensor.dtype == pb.DTYPE_FLOAT32:
            bad = values[~np.isfinite(values)]
            expect(not bad.size, f"{bad[:1]} from sensor {sensor.name!r} of {part.where}", "finite numbers")


def expect_bounded(part: Part, final: bool = False) -> None:
    """Raise Broken if an observation lies outside the bounds of its sensor."""
    for sensor, values in part.sensed(final):
        flat = values.reshape(len(values), -1).astype(np.float64)
        size = flat.shape[1]
        for bounds, sign, side in ((sensor.low, 1, "at least"), (sensor.high, -1, "at most")):
            if len(bounds) in (1, size):
                bad = sign * flat < sign * np.array(bounds)
                limit = np.broadcast_to(np.array(bounds), flat.shape)[bad][:1]
                came = f"{flat[bad][:1]} from sensor {sensor.name!r} of {part.where}"
                expect(not bad.any(), came, f"{side} {limit}")


def arena_rows(step: pb.Step, spec: pb.GameSpec, arenas: int) -> list[list[object]]:
    """Return what happened in each arena, as far as it can be read, whatever the arenas beside it did."""
    rows: list[list[object]] = [[] for _ in range(arenas)]
    for part in parts_of(step, spec, arenas, 0):
        kind = part.behavior
        per_lane = [values for _, values in part.sensed()]
        per_lane += [part.allowed(index) for index in range(len(kind.device.branches))]
        per_lane += [array for array in (part.rewards, part.terminated, part.truncated) if array is not None]
        per_lane.append(part.deciding)
        ended = np.flatnonzero(part.ended)
        per_end = [values for _, values in part.sensed(final=True)]
        metrics = read(part.message.ended.metrics, pb.DTYPE_FLOAT32, (len(ended), len(kind.metrics)))
        per_end += [metrics] if metrics is not None else []
        for arena, row in enumerate(rows):
            agents = kind.agents_per_arena
            row += [array[arena * agents : (arena + 1) * agents].tobytes() for array in per_lane]
            mine = ended // agents == arena
            row += [array[mine].tobytes() for array in per_end if mine.any()]
    return rows
