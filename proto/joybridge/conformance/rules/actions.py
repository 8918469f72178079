"""Illegal actions: each is refused with INVALID_ARGUMENT and a sentence that names what is wrong."""

import numpy as np

from joybridge.conformance.damage import (
    actions_of,
    each_behavior,
    each_with,
    refuse_array,
    refuse_axis,
    refuse_choice,
    refuse_surplus,
    refuse_tensor,
)
from joybridge.conformance.registry import check, expect, needs
from joybridge.conformance.subject import Subject, act_request, record
from joybridge.contract.tensors import pack
from joybridge.v1 import bridge_pb2 as pb


@check("Axis")
def an_axis_above_its_range_is_refused(subject: Subject) -> None:
    """The value of an action lies in [low, high]."""
    refuse_axis(subject, lambda axis: np.nextafter(np.float32(axis.high), np.float32(np.inf)))


@check("Axis")
def an_axis_below_its_range_is_refused(subject: Subject) -> None:
    """The value of an action lies in [low, high]."""
    refuse_axis(subject, lambda axis: np.nextafter(np.float32(axis.low), np.float32(-np.inf)))


@check("Axis")
def an_axis_far_out_of_its_range_is_refused(subject: Subject) -> None:
    """The value of an action lies in [low, high]; a server does not clip it in silence."""
    refuse_axis(subject, lambda axis: np.float32(3e38))


@check("Tensor")
def an_axis_that_is_nan_is_refused(subject: Subject) -> None:
    """FLOAT32 values must be finite."""
    refuse_axis(subject, lambda axis: np.float32(np.nan), "axes")


@check("Tensor")
def an_axis_that_is_infinite_is_refused(subject: Subject) -> None:
    """FLOAT32 values must be finite."""
    refuse_axis(subject, lambda axis: np.float32(np.inf), "axes")
    refuse_axis(subject, lambda axis: np.float32(-np.inf), "axes")


@check("Axis")
def an_axis_may_be_at_either_end_of_its_range(subject: Subject) -> None:
    """The value of an action lies in [low, high], inclusive."""
    for prefix, act, index, _ in each_with(subject, "axes"):
        device = subject.spec.behaviors[index].device
        for end in ("low", "high"):
            values = actions_of(act, index, "axes")
            values[:] = [getattr(axis, end) for axis in device.axes]
            act.behaviors[index].axes.CopyFrom(pack(values))
            subject.answered(*prefix, act_request(act))


@check("Branch")
def a_negative_choice_is_refused(subject: Subject) -> None:
    """A discrete action is one choice by its index, which is not counted from the end."""
    refuse_choice(subject, lambda branch: -1)


@check("Branch")
def a_choice_beyond_the_last_is_refused(subject: Subject) -> None:
    """A discrete action is one choice by its index."""
    refuse_choice(subject, lambda branch: len(branch.choices))


@check("Branch")
def a_choice_far_beyond_the_last_is_refused(subject: Subject) -> None:
    """A discrete action is one choice by its index, and no remainder of it."""
    refuse_choice(subject, lambda branch: 2**31 - 1)
    refuse_choice(subject, lambda branch: -(2**31))


@check("BehaviorAct")
def a_masked_choice_is_refused(subject: Subject) -> None:
    """Each choice is an unmasked one."""
    found = False
    recording = subject.brief
    for moment in range(len(recording.requests) - 1):
        for index, part in enumerate(recording.parts(moment)):
            for place, branch in enumerate(part.behavior.device.branches):
                forbidden = np.argwhere(~part.allowed(place) & part.deciding[:, None])
                if forbidden.size:
                    found = True
                    lane, choice = forbidden[0]
                    act = pb.Act()
                    act.CopyFrom(recording.requests[moment + 1].act)
                    values = actions_of(act, index, "choices")
                    values[lane, place] = choice
                    act.behaviors[index].choices.CopyFrom(pack(values))
                    words = [branch.name, "mask"]
                    subject.refused(*recording.requests[: moment + 1], act_request(act), words=words)
                    break
        if found:
            return
    needs(found, f"nothing is masked in the first {len(recording.requests) - 1} decisions")


@check("Act")
def an_illegal_action_in_the_last_lane_is_refused(subject: Subject) -> None:
    """The actions of all lanes are in the ranges of the device."""
    for prefix, act, index, _ in [*each_behavior(subject)]:
        recording, kind = subject.brief, subject.spec.behaviors[index]
        lane = int(np.flatnonzero(recording.parts(len(prefix) - 1)[index].deciding)[-1])
        field = "axes" if kind.device.axes else "choices"
        values = actions_of(act, index, field)
        values[lane, -1] = (
            np.nextafter(np.float32(kind.device.axes[-1].high), np.float32(np.inf)) if field == "axes" else -1
        )
        getattr(act.behaviors[index], field).CopyFrom(pack(values))
        things = kind.device.axes if field == "axes" else kind.device.branches
        subject.refused(*prefix, act_request(act), words=[things[-1].name])


@check("BehaviorAct")
def axes_with_a_lane_too_few_are_refused(subject: Subject) -> None:
    """Axes are FLOAT32 [lanes, axes]."""
    refuse_array(subject, "axes", lambda values: values[:-1])


@check("BehaviorAct")
def axes_with_a_lane_too_many_are_refused(subject: Subject) -> None:
    """Axes are FLOAT32 [lanes, axes]."""
    refuse_array(subject, "axes", lambda values: np.concatenate([values, values[:1]]))


@check("BehaviorAct")
def axes_with_a_column_too_many_are_refused(subject: Subject) -> None:
    """Axes are FLOAT32 [lanes, axes]."""
    refuse_array(subject, "axes", lambda values: np.concatenate([values, values[:, :1]], axis=1))


@check("BehaviorAct")
def axes_without_their_two_dimensions_are_refused(subject: Subject) -> None:
    """Axes are FLOAT32 [lanes, axes]."""
    refuse_array(subject, "axes", lambda values: values.reshape(-1))


@check("BehaviorAct")
def axes_of_another_dtype_are_refused(subject: Subject) -> None:
    """Axes are FLOAT32, and no other four bytes."""
    refuse_array(subject, "axes", lambda values: values.view(np.int32))


@check("Dtype")
def axes_of_no_dtype_are_refused(subject: Subject) -> None:
    """DTYPE_UNSPECIFIED is never valid."""
    refuse_tensor(subject, "axes", lambda t: pb.Tensor(shape=t.shape, data=t.data))


@check("Tensor")
def axes_with_a_byte_too_few_are_refused(subject: Subject) -> None:
    """A tensor has the bytes of its elements, and nothing before, between or after them."""
    refuse_tensor(subject, "axes", lambda t: pb.Tensor(dtype=t.dtype, shape=t.shape, data=t.data[:-1]))


@check("Tensor")
def axes_with_more_bytes_than_elements_are_refused(subject: Subject) -> None:
    """A tensor has the bytes of its elements, and nothing before, between or after them."""
    refuse_tensor(subject, "axes", lambda t: pb.Tensor(dtype=t.dtype, shape=t.shape, data=t.data + bytes(4)))


@check("BehaviorAct")
def missing_axes_are_refused(subject: Subject) -> None:
    """Axes are absent only if the device has none."""
    refuse_tensor(subject, "axes", lambda t: None)


@check("BehaviorAct")
def choices_with_a_lane_too_few_are_refused(subject: Subject) -> None:
    """Choices are INT32 [lanes, branches]."""
    refuse_array(subject, "choices", lambda values: values[:-1])


@check("BehaviorAct")
def choices_with_a_lane_too_many_are_refused(subject: Subject) -> None:
    """Choices are INT32 [lanes, branches]."""
    refuse_array(subject, "choices", lambda values: np.concatenate([values, values[:1]]))


@check("BehaviorAct")
def choices_with_a_column_too_many_are_refused(subject: Subject) -> None:
    """Choices are INT32 [lanes, branches]."""
    refuse_array(subject, "choices", lambda values: np.concatenate([values, values[:, :1]], axis=1))


@check("BehaviorAct")
def choices_without_their_two_dimensions_are_refused(subject: Subject) -> None:
    """Choices are INT32 [lanes, branches]."""
    refuse_array(subject, "choices", lambda values: values.reshape(-1))


@check("BehaviorAct")
def choices_of_another_dtype_are_refused(subject: Subject) -> None:
    """Choices are INT32, and no other four bytes."""
    refuse_array(subject, "choices", lambda values: values.astype(np.float32))


@check("Dtype")
def choices_of_no_dtype_are_refused(subject: Subject) -> None:
    """DTYPE_UNSPECIFIED is never valid."""
    refuse_tensor(subject, "choices", lambda t: pb.Tensor(shape=t.shape, data=t.data))


@check("Tensor")
def choices_with_a_byte_too_few_are_refused(subject: Subject) -> None:
    """A tensor has the bytes of its elements, and nothing before, between or after them."""
    refuse_tensor(subject, "choices", lambda t: pb.Tensor(dtype=t.dtype, shape=t.shape, data=t.data[:-1]))


@check("Tensor")
def choices_with_more_bytes_than_elements_are_refused(subject: Subject) -> None:
    """A tensor has the bytes of its elements, and nothing before, between or after them."""
    refuse_tensor(subject, "choices", lambda t: pb.Tensor(dtype=t.dtype, shape=t.shape, data=t.data + bytes(4)))


@check("BehaviorAct")
def missing_choices_are_refused(subject: Subject) -> None:
    """Choices are absent only if the device has no branches."""
    refuse_tensor(subject, "choices", lambda t: None)


@check("BehaviorAct")
def axes_of_a_device_without_any_are_refused(subject: Subject) -> None:
    """Axes are absent if the device has none."""
    refuse_surplus(subject, "axes", "axes")


@check("BehaviorAct")
def choices_of_a_device_without_branches_are_refused(subject: Subject) -> None:
    """Choices are absent if the device has no branches."""
    refuse_surplus(subject, "choices", "branches")


@check("Act")
def an_act_without_behaviors_is_refused(subject: Subject) -> None:
    """An act has one BehaviorAct per behavior of the spec."""
    subject.refused(subject.start(), act_request(pb.Act()), words=["behavior"])


@check("Act")
def a_missing_behavior_is_refused(subject: Subject) -> None:
    """An act has one BehaviorAct per behavior of the spec."""
    for prefix, act, _, _ in each_behavior(subject):
        del act.behaviors[-1]
        subject.refused(*prefix, act_request(act), words=["behavior"])


@check("Act")
def an_extra_behavior_is_refused(subject: Subject) -> None:
    """An act has one BehaviorAct per behavior of the spec."""
    for prefix, act, _, _ in each_behavior(subject):
        act.behaviors.add().CopyFrom(act.behaviors[-1])
        subject.refused(*prefix, act_request(act), words=["behavior"])


@check("Act")
def behaviors_in_another_order_are_refused(subject: Subject) -> None:
    """The behaviors of an act stand in the order of the spec."""
    sizes = {(len(b.device.axes), len(b.device.branches), b.agents_per_arena) for b in subject.spec.behaviors}
    needs(len(sizes) == len(subject.spec.behaviors) > 1, "the game has no behaviors that differ in their tensors")
    words = [behavior.name for behavior in subject.spec.behaviors]
    for prefix, act, _, _ in each_behavior(subject):
        swapped = pb.Act(behaviors=reversed(act.behaviors))
        subject.refused(*prefix, act_request(swapped), words=words)


@check("BehaviorAct")
def the_actions_of_lanes_that_wait_change_nothing(subject: Subject) -> None:
    """Rows of lanes that do not decide are ignored."""
    recording = subject.brief
    requests = [*recording.requests]
    waited = False
    for moment in range(1, len(requests)):
        act = pb.Act()
        act.CopyFrom(requests[moment].act)
        for index, part in enumerate(recording.parts(moment - 1)):
            waits = ~part.deciding
            waited = waited or bool(waits.any())
            device = part.behavior.device
            if device.axes:
                axes = actions_of(act, index, "axes")
                axes[waits] = [axis.high for axis in device.axes]
                act.behaviors[index].axes.CopyFrom(pack(axes))
            if device.branches:
                choices = actions_of(act, index, "choices")
                last = [part.allowed(b).shape[1] - 1 - np.argmax(part.allowed(b)[:, ::-1], axis=1)
                        for b in range(len(device.branches))]  # fmt: skip
                choices[waits] = np.stack(last, axis=1)[waits]
                act.behaviors[index].choices.CopyFrom(pack(choices))
        requests[moment] = act_request(act)
    needs(waited, "every lane always decides")
    came = [record(step) for step in subject.play(*requests).steps]
    holds = came == recording.records
    expect(holds, "another play where waiting lanes acted otherwise", "the same bytes")
