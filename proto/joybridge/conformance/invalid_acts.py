"""Valid acts with one value or tensor made invalid, for the checks that expect a refusal."""

import math
from collections.abc import Callable, Iterator

import numpy as np

from joybridge.conformance.expectations import skip_unless
from joybridge.conformance.recording import act_request
from joybridge.conformance.subject import Subject
from joybridge.contract.codec import pack
from joybridge.contract.tensors import NUMPY_TYPES, Array
from joybridge.v1 import bridge_pb2 as pb

DTYPES = {"axes": pb.DTYPE_FLOAT32, "choices": pb.DTYPE_INT32}  # of the fields of BehaviorAct
DEVICE_FIELDS = {"axes": "axes", "choices": "branches"}  # fields of BehaviorAct -> of Device


def acts_with(subject: Subject, field: str) -> Iterator[tuple[list[pb.PlayRequest], pb.Act, int, int]]:
    """Yield requests, a valid Act to send next, the index of a behavior that has `field`, and a deciding lane."""
    part = DEVICE_FIELDS[field]
    behaviors = [index for index, kind in enumerate(subject.spec.behaviors) if getattr(kind.device, part)]
    skip_unless(behaviors, f"no device has {part}")
    for index in behaviors:
        prefix, act, lane = subject.acting(index)
        yield prefix, act, index, lane


def acts_of_each_behavior(subject: Subject) -> Iterator[tuple[list[pb.PlayRequest], pb.Act, int]]:
    """Yield requests, a valid Act to send next, and the index of a behavior that has a deciding lane."""
    for index in range(len(subject.spec.behaviors)):
        prefix, act, _ = subject.acting(index)
        yield prefix, act, index


def copy_actions(act: pb.Act, behavior: int, field: str) -> Array:
    """Return a copy of the axes or the choices of one behavior."""
    tensor = getattr(act.behaviors[behavior], field)
    return np.frombuffer(tensor.data, NUMPY_TYPES[DTYPES[field]]).reshape(tuple(tensor.shape)).copy()


def expect_axis_refused(subject: Subject, value: Callable[[pb.Axis], np.float32], *words: str) -> None:
    """Expect the value for each axis to be refused with a text that has the axis's name or one of `words`."""
    for prefix, act, index, lane in acts_with(subject, "axes"):
        valid = copy_actions(act, index, "axes")
        for column, axis in enumerate(subject.spec.behaviors[index].device.axes):
            if not math.isfinite(value(axis)) or not axis.low <= value(axis) <= axis.high:
                invalid = valid.copy()
                invalid[lane, column] = value(axis)
                act.behaviors[index].axes.CopyFrom(pack(invalid))
                subject.expect_refused(*prefix, act_request(act), words=[axis.name, *words])


def expect_choice_refused(subject: Subject, value: Callable[[pb.Branch], int]) -> None:
    """Expect the value for each branch to be refused with a text that has the branch's name."""
    for prefix, act, index, lane in acts_with(subject, "choices"):
        valid = copy_actions(act, index, "choices")
        for column, branch in enumerate(subject.spec.behaviors[index].device.branches):
            invalid = valid.copy()
            invalid[lane, column] = value(branch)
            act.behaviors[index].choices.CopyFrom(pack(invalid))
            subject.expect_refused(*prefix, act_request(act), words=[branch.name])


def expect_array_refused(subject: Subject, field: str, change: Callable[[Array], Array]) -> None:
    """Expect a changed array of actions to be refused with a text that has the field's name."""
    for prefix, act, index, _ in acts_with(subject, field):
        values = change(copy_actions(act, index, field))
        getattr(act.behaviors[index], field).CopyFrom(pack(np.ascontiguousarray(values)))
        subject.expect_refused(*prefix, act_request(act), words=[field])


def expect_tensor_refused(subject: Subject, field: str, change: Callable[[pb.Tensor], pb.Tensor | None]) -> None:
    """Expect a changed tensor of actions, or its absence, to be refused with a text that has the field's name."""
    for prefix, act, index, _ in acts_with(subject, field):
        tensor = change(getattr(act.behaviors[index], field))
        act.behaviors[index].ClearField(field)
        if tensor is not None:
            getattr(act.behaviors[index], field).CopyFrom(tensor)
        subject.expect_refused(*prefix, act_request(act), words=[field])


def expect_field_refused(subject: Subject, field: str) -> None:
    """Expect a tensor to be refused where the device has no axes, or no branches, for it."""
    part = DEVICE_FIELDS[field]
    without = [index for index, kind in enumerate(subject.spec.behaviors) if not getattr(kind.device, part)]
    skip_unless(without, f"every device has {part}")
    for index in without:
        prefix, act, _ = subject.acting(index)
        lanes = subject.short_session.first[index].lanes
        getattr(act.behaviors[index], field).CopyFrom(pack(np.zeros((lanes, 1), NUMPY_TYPES[DTYPES[field]])))
        subject.expect_refused(*prefix, act_request(act), words=[field])
