"""Conversion between arrays and messages: of a tensor, of actions and of a step.

`ActArrays` and `StepArrays` are one BehaviorAct and one BehaviorStep as arrays. A `Format` unpacks the tensors of one
field, a `Codec` the messages of one behavior. Both check every rule of the contract about them, so code that uses the
result checks nothing of this. Packing checks nothing.
"""

import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from joybridge.contract.tensors import NUMPY_TYPES, Array, TensorError
from joybridge.v1 import bridge_pb2 as pb

__all__ = [
    "ActArrays",
    "Codec",
    "Format",
    "StepArrays",
    "dtype_of",
    "fill",
    "fill_act",
    "fill_step",
    "lane_count",
    "pack",
    "pack_act",
]

_DTYPES = {numpy_type: dtype for dtype, numpy_type in NUMPY_TYPES.items()}
_NO_LANES = np.empty(0, np.int32)


@dataclass
class ActArrays:
    """The actions of all lanes of one behavior."""

    axes: Array  # float32 [lanes, axes]
    choices: Array  # int32 [lanes, branches]
    scripts: Array | None = None  # int32 [lanes]: 0, or the script of the spec that acts, from 1 on; None: 0 for all

    def rows(self, lanes: "Array | slice") -> "ActArrays":
        """Return the actions of some lanes."""
        scripts = None if self.scripts is None else self.scripts[lanes]
        return ActArrays(self.axes[lanes], self.choices[lanes], scripts)


@dataclass
class StepArrays:
    """The result of one decision for all lanes of one behavior; see BehaviorStep in bridge.proto."""

    observations: list[Array]  # per sensor [lanes, *shape]
    rewards: Array  # float32 [lanes, channels]
    terminated: Array  # bool [lanes]
    truncated: Array  # bool [lanes]
    masks: list[Array] | None = None  # per branch bool [lanes, choices]; None: all allowed
    deciding: Array | None = None  # bool [lanes]; None: every lane decides
    ended: Array = field(default_factory=lambda: _NO_LANES)  # int32 [ended], ascending
    final_observations: list[Array] | None = None  # per sensor [ended, *shape]; None if nothing ended
    metrics: Array | None = None  # float32 [ended, metrics]; None if nothing ended or there are none
    parameters: Array | None = None  # float32 [ended, parameters]; None if nothing ended or none is drawn per episode
    interrupted: Array | None = None  # bool [ended]: the game failed, see Ended in bridge.proto; None: in none of them

    @property
    def ends(self) -> Array:
        """In which lanes an episode has ended, bool [lanes]."""
        return self.terminated | self.truncated

    @property
    def decides(self) -> Array:
        """Which lanes decide next, bool [lanes]."""
        return np.ones(len(self.terminated), bool) if self.deciding is None else self.deciding


def lane_count(behavior: pb.Behavior, arenas: int) -> int:
    """Return the number of lanes of a behavior in a session of `arenas`."""
    return arenas * behavior.agents_per_arena


def pack_act(act: ActArrays) -> pb.BehaviorAct:
    """Return the message of one behavior's actions."""
    message = pb.BehaviorAct()
    fill_act(message, act)
    return message


def fill_act(message: pb.BehaviorAct, act: ActArrays) -> None:
    """Fill an empty message with actions. A message inside a larger one is filled in place, without a copy."""
    if act.axes.shape[1]:
        fill(message.axes, act.axes)
    if act.choices.shape[1]:
        fill(message.choices, act.choices)
    if act.scripts is not None:
        fill(message.scripts, act.scripts)


def fill_step(message: pb.BehaviorStep, step: StepArrays) -> None:
    """Fill an empty message with a step. A message inside a larger one is filled in place, without a copy."""
    for observation in step.observations:
        fill(message.observations.add(), observation)
    fill(message.rewards, step.rewards)
    fill(message.terminated, step.terminated)
    fill(message.truncated, step.truncated)
    for mask in step.masks or ():
        fill(message.masks.add(), mask)
    if step.deciding is not None:
        fill(message.deciding, step.deciding)
    if len(step.ended):
        fill(message.ended.lanes, step.ended)
        for observation in step.final_observations or ():
            fill(message.ended.final_observations.add(), observation)
        if step.metrics is not None:
            fill(message.ended.metrics, step.metrics)
        if step.parameters is not None:
            fill(message.ended.parameters, step.parameters)
        if step.interrupted is not None:
            fill(message.ended.interrupted, step.interrupted)


def dtype_of(array: Array) -> "pb.Dtype":
    """Return the wire dtype of an array. Raises TensorError for a dtype that the contract does not have."""
    try:
        return _DTYPES[array.dtype.newbyteorder("<") if sys.byteorder == "big" else array.dtype]
    except KeyError:
        known = ", ".join(str(t) for t in _DTYPES)
        raise TensorError(f"an array of {array.dtype} cannot be sent; convert it to one of {known}") from None


def fill(tensor: pb.Tensor, array: Array) -> None:
    """Put `array` into an empty tensor. Raises TensorError for a dtype that the contract does not have."""
    dtype = dtype_of(array)
    tensor.dtype = dtype
    tensor.shape.extend(array.shape)
    tensor.data = array.astype(NUMPY_TYPES[dtype], copy=False).tobytes()


def pack(array: Array) -> pb.Tensor:
    """Return `array` as a Tensor. Raises TensorError for a dtype that the contract does not have."""
    tensor = pb.Tensor()
    fill(tensor, array)
    return tensor


class Format:
    """The dtype and shape that the tensors of one field must have. It is made once per session."""

    def __init__(self, dtype: "pb.Dtype", shape: tuple[int, ...], field: str, path: str = "") -> None:
        """Require `dtype` and `shape`. The text of errors names `field`; their `field` is `path`."""
        self.dtype, self.shape, self.field, self.path = dtype, shape, field, path
        self.sizes = list(shape)
        self.numpy_type = NUMPY_TYPES[dtype]
        self.bytes = math.prod(shape) * self.numpy_type.itemsize

    def unpack(self, tensor: pb.Tensor) -> Array:
        """Return the array in `tensor`, read-only, after checking it.

        Raises TensorError if dtype, shape or byte length differ, if a float is NaN or infinite, or if a
        boolean is neither 0 nor 1.
        """
        if tensor.dtype != self.dtype:
            came, wanted = _dtype_name(tensor.dtype), _dtype_name(self.dtype)
            raise self._wrong(f"dtype is {came}, expected {wanted}")
        if tensor.shape != self.sizes:
            raise self._wrong(f"shape is {_cut(list(tensor.shape))}, expected {self.sizes}")
        data = tensor.data
        if len(data) != self.bytes:
            raise self._wrong(f"{len(data)} bytes of data, expected {self.bytes} for shape {self.sizes}")
        if self.dtype == pb.DTYPE_BOOL and (others := data.translate(None, b"\0\1")):
            raise self._wrong(f"a boolean is {max(others)}, expected 0 or 1")
        array: Array = np.ndarray(self.shape, self.numpy_type, data)
        # A finite sum of squares means that all values are finite. It is faster than testing each value.
        if self.dtype == pb.DTYPE_FLOAT32 and not math.isfinite(np.vdot(array, array)) and not np.isfinite(array).all():
            index = np.argwhere(~np.isfinite(array))[0].tolist()
            raise self._wrong(f"value {array[tuple(index)]} at {index}, expected finite numbers", pb.REASON_NOT_FINITE)
        return array

    def _wrong(self, text: str, reason: "pb.Reason" = pb.REASON_WRONG_TENSOR) -> TensorError:
        return TensorError(f"{self.field}: {text}", reason, self.path)


class Codec:
    """Unpacks and checks the acts and steps of one behavior in one session."""

    def __init__(self, behavior: pb.Behavior, arenas: int, parameters: int = 0) -> None:
        """Compute the required dtype and shape of every tensor of a session with `arenas` arenas.

        parameters: how many the game has.
        """
        self.name = name = behavior.name
        self.lanes = lanes = lane_count(behavior, arenas)
        self.metrics = len(behavior.metrics)
        self.parameters = parameters
        device = behavior.device
        self._axis_names = [axis.name for axis in device.axes]
        self._low = np.array([axis.low for axis in device.axes], np.float32)
        self._high = np.array([axis.high for axis in device.axes], np.float32)
        self._branches = [(branch.name, list(branch.choices)) for branch in device.branches]
        self._counts = np.array([len(choices) for _, choices in self._branches], np.int32)
        self._axes = Format(pb.DTYPE_FLOAT32, (lanes, len(device.axes)), f"{name}.axes", "axes")
        self._choices = Format(pb.DTYPE_INT32, (lanes, len(device.branches)), f"{name}.choices", "choices")
        self._scripts = Format(pb.DTYPE_INT32, (lanes,), f"{name}.scripts", "scripts")
        self._script_names = [script.name for script in behavior.scripts]
        self._sensors = [(sensor.name, sensor.dtype, tuple(sensor.shape)) for sensor in behavior.sensors]
        self._observations = self._sensor_formats(lanes, "observations")
        self._rewards = Format(pb.DTYPE_FLOAT32, (lanes, len(behavior.channels)), f"{name}.rewards")
        self._terminated = Format(pb.DTYPE_BOOL, (lanes,), f"{name}.terminated")
        self._truncated = Format(pb.DTYPE_BOOL, (lanes,), f"{name}.truncated")
        self._deciding = Format(pb.DTYPE_BOOL, (lanes,), f"{name}.deciding")
        self._masks = [
            Format(pb.DTYPE_BOOL, (lanes, len(choices)), f"{name}.masks[{branch}]")
            for branch, choices in self._branches
        ]

    def _sensor_formats(self, lanes: int, field: str) -> list[Format]:
        return [
            Format(dtype, (lanes, *shape), f"{self.name}.{field}[{sensor}]") for sensor, dtype, shape in self._sensors
        ]

    def unpack_act(self, message: pb.BehaviorAct, previous: StepArrays) -> ActArrays:
        """Return the actions, checked against the device and the masks of the previous step.

        Raises TensorError naming the lane and the axis or branch that is out of range or masked. The rows of lanes
        that do not decide, or that a script plays, must be well-formed; their values are ignored.
        """
        axes = np.empty(self._axes.shape, np.float32)
        choices = np.empty(self._choices.shape, np.int32)
        if self._axis_names or message.HasField("axes"):
            axes = self._axes.unpack(message.axes)
        if self._branches or message.HasField("choices"):
            choices = self._choices.unpack(message.choices)
        scripts = self._unpack_scripts(message) if message.HasField("scripts") else None
        counts = previous.deciding
        if scripts is not None:
            counts = scripts == 0 if counts is None else counts & (scripts == 0)
        if counts is not None:  # actions of the other lanes are ignored: replace them by valid ones
            axes = np.where(counts[:, None], axes, self._low)
            choices = np.where(counts[:, None], choices, np.int32(0))
        if not ((axes >= self._low) & (axes <= self._high)).all():
            self._refuse_axes(axes)
        if not (choices.view(np.uint32) < self._counts).all():  # negative numbers are large as unsigned ones
            self._refuse_choices(choices)
        if previous.masks is not None:
            self._refuse_masked(choices, previous.masks, counts)
        return ActArrays(axes, choices, scripts)

    def _unpack_scripts(self, message: pb.BehaviorAct) -> Array:
        scripts, known = self._scripts.unpack(message.scripts), self._script_names
        for lane in np.flatnonzero((scripts < 0) | (scripts > len(known))):
            names = f" for {', '.join(known)}" if known else ": it has no scripts"
            text = f"got {scripts[lane]} in lane {lane}, expected 0..{len(known)}{names}"
            raise TensorError(f"{self.name}.scripts: {text}", pb.REASON_ACTION_OUT_OF_RANGE, "scripts")
        return scripts

    def _refuse_axes(self, axes: Array) -> None:
        for axis, low, high, column in zip(self._axis_names, self._low, self._high, axes.T, strict=True):
            for lane in np.flatnonzero((column < low) | (column > high)):
                text = f"axis {axis!r} got {column[lane]} in lane {lane}, expected {low:g}..{high:g}"
                raise TensorError(f"{self.name}.axes: {text}", pb.REASON_ACTION_OUT_OF_RANGE, "axes")

    def _refuse_choices(self, choices: Array) -> None:
        for (branch, names), column in zip(self._branches, choices.T, strict=True):
            for lane in np.flatnonzero((column < 0) | (column >= len(names))):
                text = f"branch {branch!r} got {column[lane]} in lane {lane}, expected 0..{len(names) - 1}"
                raise TensorError(f"{self.name}.choices: {text}", pb.REASON_ACTION_OUT_OF_RANGE, "choices")

    def _refuse_masked(self, choices: Array, masks: list[Array], counts: Array | None) -> None:
        for (branch, names), mask, column in zip(self._branches, masks, choices.T, strict=True):
            forbidden = ~mask[np.arange(self.lanes), column]
            if counts is not None:
                forbidden &= counts
            for lane in np.flatnonzero(forbidden):
                text = (
                    f"branch {branch!r} got {names[column[lane]]!r} in lane {lane}, which its mask forbids in this step"
                )
                raise TensorError(f"{self.name}.choices: {text}", pb.REASON_ACTION_MASKED, "choices")

    def unpack_step(self, message: pb.BehaviorStep) -> StepArrays:
        """Return the step, checked against the spec. Raises TensorError naming the field."""
        step = StepArrays(
            observations=self._unpack_sensors(message.observations, self._observations, "observations"),
            rewards=self._rewards.unpack(message.rewards),
            terminated=self._terminated.unpack(message.terminated),
            truncated=self._truncated.unpack(message.truncated),
        )
        if message.masks:
            step.masks = self._unpack_masks(message.masks)
        if message.HasField("deciding"):
            step.deciding = self._deciding.unpack(message.deciding)
        ended = np.flatnonzero(step.ends)
        if len(ended) or message.HasField("ended"):
            self._unpack_ended(message.ended, step, ended)
        return step

    def _unpack_ended(self, message: pb.Ended, step: StepArrays, ended: Array) -> None:
        for lane in np.flatnonzero(step.terminated & step.truncated):
            raise TensorError(f"{self.name}: lane {lane} is both terminated and truncated, expected at most one")
        where = f"{self.name}.ended"
        step.ended = Format(pb.DTYPE_INT32, (len(ended),), f"{where}.lanes").unpack(message.lanes)
        if (step.ended != ended).any():
            came, wanted = step.ended.tolist(), ended.tolist()
            raise TensorError(f"{where}.lanes: got {came}, expected the terminated and truncated lanes {wanted}")
        field = "ended.final_observations"
        formats = self._sensor_formats(len(ended), field)
        step.final_observations = self._unpack_sensors(message.final_observations, formats, field)
        if self.metrics:
            step.metrics = Format(pb.DTYPE_FLOAT32, (len(ended), self.metrics), f"{where}.metrics").unpack(
                message.metrics
            )
        if message.HasField("parameters"):
            form = Format(pb.DTYPE_FLOAT32, (len(ended), self.parameters), f"{where}.parameters")
            step.parameters = form.unpack(message.parameters)
        if message.HasField("interrupted"):
            step.interrupted = Format(pb.DTYPE_BOOL, (len(ended),), f"{where}.interrupted").unpack(message.interrupted)
            for lane in ended[step.interrupted & ~step.truncated[ended]]:
                raise TensorError(f"{where}.interrupted: lane {lane} is interrupted, but not truncated")

    def _unpack_sensors(self, tensors: Sequence[pb.Tensor], formats: list[Format], field: str) -> list[Array]:
        if len(tensors) != len(formats):
            where = f"{self.name}.{field}"
            raise TensorError(f"{where}: {len(tensors)} tensors, expected {len(formats)}, one per sensor")
        return [form.unpack(tensor) for form, tensor in zip(formats, tensors, strict=True)]

    def _unpack_masks(self, tensors: Sequence[pb.Tensor]) -> list[Array]:
        if len(tensors) != len(self._masks):
            where = f"{self.name}.masks"
            raise TensorError(f"{where}: {len(tensors)} tensors, expected {len(self._masks)}, one per branch, or none")
        masks = [form.unpack(tensor) for form, tensor in zip(self._masks, tensors, strict=True)]
        for form, mask in zip(self._masks, masks, strict=True):
            for lane in np.flatnonzero(~mask.any(axis=1)):
                raise TensorError(f"{form.field}: lane {lane} allows no choice, expected at least one")
        return masks


def _dtype_name(dtype: "pb.Dtype") -> str:
    return pb.Dtype.Name(dtype) if dtype in pb.Dtype.values() else f"unknown ({dtype})"


def _cut(shape: list[int]) -> str:
    return str(shape) if len(shape) <= 8 else f"{len(shape)} sizes long"
