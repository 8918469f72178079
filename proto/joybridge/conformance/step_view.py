"""A BehaviorStep as arrays. A malformed tensor reads as None, so that it fails only the check that is about it."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from math import prod

import numpy as np

from joybridge.contract.tensors import NUMPY_TYPES, Array
from joybridge.v1 import bridge_pb2 as pb


def tensor_error(tensor: pb.Tensor, dtype: pb.Dtype, shape: tuple[int, ...]) -> str:
    """Return what is wrong with the dtype, shape or data of a tensor, or "" if it is well-formed."""
    if tensor.dtype != dtype:
        return f"dtype {tensor.dtype}"
    if tuple(tensor.shape) != shape:
        return f"shape {list(tensor.shape)}"
    if len(tensor.data) != prod(shape) * NUMPY_TYPES[dtype].itemsize:
        return f"{len(tensor.data)} bytes of data"
    if dtype == pb.DTYPE_BOOL and tensor.data and max(tensor.data) > 1:
        return f"a boolean of value {max(tensor.data)}"
    return ""


def read_tensor(tensor: pb.Tensor, dtype: pb.Dtype, shape: tuple[int, ...]) -> Array | None:
    """Return the array in a tensor, which may hold NaN, or None if the tensor is malformed."""
    if dtype not in NUMPY_TYPES or tensor_error(tensor, dtype, shape):
        return None
    return np.frombuffer(tensor.data, NUMPY_TYPES[dtype]).reshape(shape)


@dataclass(frozen=True)
class StepView:
    """One behavior's part of a step, read with the shapes that the spec gives."""

    message: pb.BehaviorStep
    behavior: pb.Behavior
    arenas: int
    where: str  # the behavior and the number of decisions, for failure texts

    @property
    def lanes(self) -> int:
        """Return the number of lanes."""
        return self.arenas * self.behavior.agents_per_arena

    @cached_property
    def terminated(self) -> Array | None:
        """Return which lanes terminated, or None if the tensor is malformed."""
        return read_tensor(self.message.terminated, pb.DTYPE_BOOL, (self.lanes,))

    @cached_property
    def truncated(self) -> Array | None:
        """Return which lanes were truncated, or None if the tensor is malformed."""
        return read_tensor(self.message.truncated, pb.DTYPE_BOOL, (self.lanes,))

    @cached_property
    def ended(self) -> Array:
        """Return which lanes ended; a malformed flag counts as false."""
        none = np.zeros(self.lanes, bool)
        terminated, truncated = self.terminated, self.truncated
        return (none if terminated is None else terminated) | (none if truncated is None else truncated)

    @cached_property
    def deciding(self) -> Array:
        """Return which lanes decide next: all if the tensor is absent or malformed."""
        message = self.message
        deciding = read_tensor(message.deciding, pb.DTYPE_BOOL, (self.lanes,)) if message.HasField("deciding") else None
        return np.ones(self.lanes, bool) if deciding is None else deciding

    @property
    def rewards(self) -> Array | None:
        """Return the rewards [lanes, channels], or None if the tensor is malformed."""
        return read_tensor(self.message.rewards, pb.DTYPE_FLOAT32, (self.lanes, len(self.behavior.channels)))

    def allowed(self, branch: int) -> Array:
        """Return the allowed choices of a branch [lanes, choices]: all if the mask is absent or malformed."""
        count = len(self.behavior.device.branches[branch].choices)
        masks = self.message.masks
        mask = read_tensor(masks[branch], pb.DTYPE_BOOL, (self.lanes, count)) if branch < len(masks) else None
        return np.ones((self.lanes, count), bool) if mask is None else mask

    def observations(self, final: bool = False) -> Iterator[tuple[pb.Sensor, Array]]:
        """Yield each sensor with its observation, or final observation; malformed ones are left out."""
        tensors = self.message.ended.final_observations if final else self.message.observations
        rows = int(self.ended.sum()) if final else self.lanes
        for tensor, sensor in zip(tensors, self.behavior.sensors, strict=False):
            values = read_tensor(tensor, sensor.dtype, (rows, *sensor.shape))
            if values is not None:
                yield sensor, values


def views_of(step: pb.Step, spec: pb.GameSpec, arenas: int, decisions: int) -> list[StepView]:
    """Return one view per behavior of a step that followed so many decisions."""
    return [
        StepView(message, behavior, arenas, f"{behavior.name} after {decisions} decisions")
        for message, behavior in zip(step.behaviors, spec.behaviors, strict=False)
    ]


def arena_rows(step: pb.Step, spec: pb.GameSpec, arenas: int) -> list[list[bytes]]:
    """Return the data of each arena as bytes, to compare one arena between sessions of different sizes."""
    rows: list[list[bytes]] = [[] for _ in range(arenas)]
    for view in views_of(step, spec, arenas, 0):
        behavior = view.behavior
        per_lane = [values for _, values in view.observations()]
        per_lane += [view.allowed(index) for index in range(len(behavior.device.branches))]
        per_lane += [array for array in (view.rewards, view.terminated, view.truncated) if array is not None]
        per_lane.append(view.deciding)
        ended = np.flatnonzero(view.ended)
        per_end = [values for _, values in view.observations(final=True)]
        metrics = read_tensor(view.message.ended.metrics, pb.DTYPE_FLOAT32, (len(ended), len(behavior.metrics)))
        parameters = read_tensor(view.message.ended.parameters, pb.DTYPE_FLOAT32, (len(ended), len(spec.parameters)))
        per_end += [array for array in (metrics, parameters) if array is not None]
        for arena, row in enumerate(rows):
            agents = behavior.agents_per_arena
            row += [array[arena * agents : (arena + 1) * agents].tobytes() for array in per_lane]
            own = ended // agents == arena
            row += [array[own].tobytes() for array in per_end if own.any()]
    return rows
