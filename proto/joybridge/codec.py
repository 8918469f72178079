"""Actions and steps as arrays, and their way into messages and back.

`ActArrays` and `StepArrays` are one BehaviourAct and one BehaviourStep as arrays. Unpacking checks
everything the contract says about them against the spec; packing trusts its caller.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from joybridge.tensors import Array, TensorError, pack, unpack
from joybridge.v1 import bridge_pb2 as pb


@dataclass
class ActArrays:
    """The actions of all lanes of one behaviour."""

    axes: Array  # float32 [lanes, axes]
    choices: Array  # int32 [lanes, branches]


@dataclass
class StepArrays:
    """What happened to all lanes of one behaviour in one decision; see BehaviourStep in bridge.proto."""

    observations: list[Array]  # per sensor [lanes, *shape]
    rewards: Array  # float32 [lanes, channels]
    terminated: Array  # bool [lanes]
    truncated: Array  # bool [lanes]
    masks: list[Array] | None = None  # per branch bool [lanes, choices]; None: all allowed
    deciding: Array | None = None  # bool [lanes]; None: every lane decides
    ended: Array = field(default_factory=lambda: np.empty(0, np.int32))  # int32 [ended], ascending
    final_observations: list[Array] | None = None  # per sensor [ended, *shape]; None if nothing ended
    metrics: Array | None = None  # float32 [ended, metrics]; None if nothing ended or there are none


def lane_count(behaviour: pb.Behaviour, arenas: int) -> int:
    """Return the number of lanes of a behaviour in a session of `arenas`."""
    return arenas * behaviour.agents_per_arena


def pack_act(act: ActArrays) -> pb.BehaviourAct:
    """Return the message of one behaviour's actions."""
    return pb.BehaviourAct(
        axes=pack(act.axes) if act.axes.shape[1] else None,
        choices=pack(act.choices) if act.choices.shape[1] else None,
    )


def unpack_act(message: pb.BehaviourAct, behaviour: pb.Behaviour, previous: StepArrays) -> ActArrays:
    """Return one behaviour's actions, checked against the device and the masks of the previous step.

    Raises TensorError naming the lane and the axis or branch that is out of range or masked. Lanes that
    do not decide must be well-formed and are otherwise ignored.
    """
    lanes = len(previous.rewards)
    device, name = behaviour.device, behaviour.name
    axes = np.empty((lanes, 0), np.float32)
    choices = np.empty((lanes, 0), np.int32)
    if message.HasField("axes") or device.axes:
        axes = unpack(message.axes, pb.FLOAT32, (lanes, len(device.axes)), f"{name}.axes")
    if message.HasField("choices") or device.branches:
        choices = unpack(message.choices, pb.INT32, (lanes, len(device.branches)), f"{name}.choices")
    if previous.deciding is not None:  # what the other lanes do must not matter: give them any valid action
        rest = np.array([axis.low for axis in device.axes], np.float32)
        axes = np.where(previous.deciding[:, None], axes, rest)
        choices = np.where(previous.deciding[:, None], choices, np.int32(0))
    for index, axis in enumerate(device.axes):
        _check_range(axes[:, index], axis.low, axis.high, f"{name}.axes: axis {axis.name!r}")
    for index, branch in enumerate(device.branches):
        where = f"{name}.choices: branch {branch.name!r}"
        _check_range(choices[:, index], 0, len(branch.choices) - 1, where)
        if previous.masks is not None:
            allowed = previous.masks[index][np.arange(lanes), choices[:, index]]
            if previous.deciding is not None:
                allowed |= ~previous.deciding
            if not allowed.all():
                lane = int(np.argmin(allowed))
                choice = branch.choices[choices[lane, index]]
                raise TensorError(f"{where} got {choice!r} in lane {lane}, which its mask forbids in this step")
    return ActArrays(axes, choices)


def _check_range(column: Array, low: float, high: float, where: str) -> None:
    if column.size and (column.min() < low or column.max() > high):
        lane = int(np.argmax((column < low) | (column > high)))
        raise TensorError(f"{where} got {column[lane]} in lane {lane}, expected {low:g}..{high:g}")


def pack_step(step: StepArrays) -> pb.BehaviourStep:
    """Return the message of one behaviour's step."""
    message = pb.BehaviourStep(
        observations=[pack(o) for o in step.observations],
        rewards=pack(step.rewards),
        terminated=pack(step.terminated),
        truncated=pack(step.truncated),
    )
    if step.masks is not None:
        message.masks.extend(pack(mask) for mask in step.masks)
    if step.deciding is not None:
        message.deciding.CopyFrom(pack(step.deciding))
    if len(step.ended):
        message.ended.lanes.CopyFrom(pack(step.ended))
        message.ended.final_observations.extend(pack(o) for o in step.final_observations or [])
        if step.metrics is not None:
            message.ended.metrics.CopyFrom(pack(step.metrics))
    return message


def unpack_step(message: pb.BehaviourStep, behaviour: pb.Behaviour, arenas: int) -> StepArrays:
    """Return one behaviour's step, checked against the spec. Raises TensorError naming the field."""
    lanes = lane_count(behaviour, arenas)
    name = behaviour.name
    step = StepArrays(
        observations=_unpack_sensors(message.observations, behaviour.sensors, lanes, f"{name}.observations"),
        rewards=unpack(message.rewards, pb.FLOAT32, (lanes, len(behaviour.channels)), f"{name}.rewards"),
        terminated=unpack(message.terminated, pb.BOOL, (lanes,), f"{name}.terminated"),
        truncated=unpack(message.truncated, pb.BOOL, (lanes,), f"{name}.truncated"),
    )
    if message.masks:
        step.masks = _unpack_masks(message.masks, behaviour.device.branches, lanes, f"{name}.masks")
    if message.HasField("deciding"):
        step.deciding = unpack(message.deciding, pb.BOOL, (lanes,), f"{name}.deciding")
    both = step.terminated & step.truncated
    if both.any():
        lane = int(np.flatnonzero(both)[0])
        raise TensorError(f"{name}: lane {lane} is both terminated and truncated, expected at most one")
    ended = np.flatnonzero(step.terminated | step.truncated).astype(np.int32)
    if len(ended) or message.HasField("ended"):
        _unpack_ended(message.ended, behaviour, step, ended)
    return step


def _unpack_ended(message: pb.Ended, behaviour: pb.Behaviour, step: StepArrays, ended: Array) -> None:
    name = f"{behaviour.name}.ended"
    step.ended = unpack(message.lanes, pb.INT32, (len(ended),), f"{name}.lanes")
    if (step.ended != ended).any():
        raise TensorError(f"{name}.lanes: {step.ended.tolist()}, expected the terminated or truncated {ended.tolist()}")
    where = f"{name}.final_observations"
    step.final_observations = _unpack_sensors(message.final_observations, behaviour.sensors, len(ended), where)
    if behaviour.metrics:
        shape = (len(ended), len(behaviour.metrics))
        step.metrics = unpack(message.metrics, pb.FLOAT32, shape, f"{name}.metrics")


def _unpack_sensors(tensors: Sequence[pb.Tensor], sensors: Sequence[pb.Sensor], lanes: int, field: str) -> list[Array]:
    if len(tensors) != len(sensors):
        raise TensorError(f"{field}: {len(tensors)} tensors, expected {len(sensors)}, one per sensor")
    return [
        unpack(tensor, sensor.dtype, (lanes, *sensor.shape), f"{field}[{sensor.name}]")
        for tensor, sensor in zip(tensors, sensors, strict=True)
    ]


def _unpack_masks(tensors: Sequence[pb.Tensor], branches: Sequence[pb.Branch], lanes: int, field: str) -> list[Array]:
    if len(tensors) != len(branches):
        raise TensorError(f"{field}: {len(tensors)} tensors, expected {len(branches)}, one per branch, or none")
    masks = []
    for tensor, branch in zip(tensors, branches, strict=True):
        mask = unpack(tensor, pb.BOOL, (lanes, len(branch.choices)), f"{field}[{branch.name}]")
        if not mask.any(axis=1).all():
            lane = int(np.flatnonzero(~mask.any(axis=1))[0])
            raise TensorError(f"{field}[{branch.name}]: lane {lane} allows no choice, expected at least one")
        masks.append(mask)
    return masks
