"""Tensors of actions: a wrong shape, dtype or length is refused with INVALID_ARGUMENT and a text that names it."""

import numpy as np

from joybridge.conformance.expectations import skip_unless
from joybridge.conformance.invalid_acts import (
    acts_of_each_behavior,
    expect_array_refused,
    expect_field_refused,
    expect_tensor_refused,
)
from joybridge.conformance.recording import act_request
from joybridge.conformance.registry import check
from joybridge.conformance.subject import Subject
from joybridge.v1 import bridge_pb2 as pb


@check("BehaviorAct")
def axes_with_a_missing_lane_are_refused(subject: Subject) -> None:
    """Axes are FLOAT32 [lanes, axes]."""
    expect_array_refused(subject, "axes", lambda values: values[:-1])


@check("BehaviorAct")
def axes_with_an_extra_lane_are_refused(subject: Subject) -> None:
    """Axes are FLOAT32 [lanes, axes]."""
    expect_array_refused(subject, "axes", lambda values: np.concatenate([values, values[:1]]))


@check("BehaviorAct")
def axes_with_an_extra_column_are_refused(subject: Subject) -> None:
    """Axes are FLOAT32 [lanes, axes]."""
    expect_array_refused(subject, "axes", lambda values: np.concatenate([values, values[:, :1]], axis=1))


@check("BehaviorAct")
def axes_with_one_dimension_are_refused(subject: Subject) -> None:
    """Axes are FLOAT32 [lanes, axes]."""
    expect_array_refused(subject, "axes", lambda values: values.reshape(-1))


@check("BehaviorAct")
def axes_of_another_dtype_are_refused(subject: Subject) -> None:
    """Axes are FLOAT32; the server does not reinterpret or convert other types."""
    expect_array_refused(subject, "axes", lambda values: values.view(np.int32))


@check("Dtype")
def axes_without_a_dtype_are_refused(subject: Subject) -> None:
    """DTYPE_UNSPECIFIED is never valid."""
    expect_tensor_refused(subject, "axes", lambda t: pb.Tensor(shape=t.shape, data=t.data))


@check("Tensor")
def axes_with_a_missing_byte_are_refused(subject: Subject) -> None:
    """A tensor has exactly the bytes of its elements."""
    expect_tensor_refused(subject, "axes", lambda t: pb.Tensor(dtype=t.dtype, shape=t.shape, data=t.data[:-1]))


@check("Tensor")
def axes_with_extra_bytes_are_refused(subject: Subject) -> None:
    """A tensor has exactly the bytes of its elements."""
    expect_tensor_refused(subject, "axes", lambda t: pb.Tensor(dtype=t.dtype, shape=t.shape, data=t.data + bytes(4)))


@check("BehaviorAct")
def missing_axes_are_refused(subject: Subject) -> None:
    """Axes are absent only if the device has no axes."""
    expect_tensor_refused(subject, "axes", lambda t: None)


@check("BehaviorAct")
def axes_for_a_device_without_axes_are_refused(subject: Subject) -> None:
    """Axes are absent if the device has no axes."""
    expect_field_refused(subject, "axes")


@check("BehaviorAct")
def choices_with_a_missing_lane_are_refused(subject: Subject) -> None:
    """Choices are INT32 [lanes, branches]."""
    expect_array_refused(subject, "choices", lambda values: values[:-1])


@check("BehaviorAct")
def choices_with_an_extra_lane_are_refused(subject: Subject) -> None:
    """Choices are INT32 [lanes, branches]."""
    expect_array_refused(subject, "choices", lambda values: np.concatenate([values, values[:1]]))


@check("BehaviorAct")
def choices_with_an_extra_column_are_refused(subject: Subject) -> None:
    """Choices are INT32 [lanes, branches]."""
    expect_array_refused(subject, "choices", lambda values: np.concatenate([values, values[:, :1]], axis=1))


@check("BehaviorAct")
def choices_with_one_dimension_are_refused(subject: Subject) -> None:
    """Choices are INT32 [lanes, branches]."""
    expect_array_refused(subject, "choices", lambda values: values.reshape(-1))


@check("BehaviorAct")
def choices_of_another_dtype_are_refused(subject: Subject) -> None:
    """Choices are INT32; the server does not reinterpret or convert other types."""
    expect_array_refused(subject, "choices", lambda values: values.astype(np.float32))


@check("Dtype")
def choices_without_a_dtype_are_refused(subject: Subject) -> None:
    """DTYPE_UNSPECIFIED is never valid."""
    expect_tensor_refused(subject, "choices", lambda t: pb.Tensor(shape=t.shape, data=t.data))


@check("Tensor")
def choices_with_a_missing_byte_are_refused(subject: Subject) -> None:
    """A tensor has exactly the bytes of its elements."""
    expect_tensor_refused(subject, "choices", lambda t: pb.Tensor(dtype=t.dtype, shape=t.shape, data=t.data[:-1]))


@check("Tensor")
def choices_with_extra_bytes_are_refused(subject: Subject) -> None:
    """A tensor has exactly the bytes of its elements."""
    expect_tensor_refused(subject, "choices", lambda t: pb.Tensor(dtype=t.dtype, shape=t.shape, data=t.data + bytes(4)))


@check("BehaviorAct")
def missing_choices_are_refused(subject: Subject) -> None:
    """Choices are absent only if the device has no branches."""
    expect_tensor_refused(subject, "choices", lambda t: None)


@check("BehaviorAct")
def choices_for_a_device_without_branches_are_refused(subject: Subject) -> None:
    """Choices are absent if the device has no branches."""
    expect_field_refused(subject, "choices")


@check("Act")
def act_without_behaviors_is_refused(subject: Subject) -> None:
    """An Act has one BehaviorAct per behavior of the spec."""
    subject.expect_refused(subject.start(), act_request(pb.Act()), words=["behavior"])


@check("Act")
def missing_behavior_is_refused(subject: Subject) -> None:
    """An Act has one BehaviorAct per behavior of the spec."""
    for prefix, act, _ in acts_of_each_behavior(subject):
        del act.behaviors[-1]
        subject.expect_refused(*prefix, act_request(act), words=["behavior"])


@check("Act")
def extra_behavior_is_refused(subject: Subject) -> None:
    """An Act has one BehaviorAct per behavior of the spec."""
    for prefix, act, _ in acts_of_each_behavior(subject):
        act.behaviors.add().CopyFrom(act.behaviors[-1])
        subject.expect_refused(*prefix, act_request(act), words=["behavior"])


@check("Act")
def behaviors_in_another_order_are_refused(subject: Subject) -> None:
    """An Act lists the behaviors in the order of the spec."""
    sizes = {(len(b.device.axes), len(b.device.branches), b.agents_per_arena) for b in subject.spec.behaviors}
    differ = len(sizes) == len(subject.spec.behaviors) > 1
    skip_unless(differ, "the game does not have several behaviors with tensors of different shapes")
    words = [behavior.name for behavior in subject.spec.behaviors]
    for prefix, act, _ in acts_of_each_behavior(subject):
        subject.expect_refused(*prefix, act_request(pb.Act(behaviors=reversed(act.behaviors))), words=words)
