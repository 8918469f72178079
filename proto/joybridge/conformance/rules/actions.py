"""Values of actions: invalid ones are refused with INVALID_ARGUMENT and a text that names the axis or branch."""

import numpy as np

from joybridge.conformance.expectations import expect, skip_unless
from joybridge.conformance.invalid_acts import (
    acts_of_each_behavior,
    acts_with,
    copy_actions,
    expect_axis_refused,
    expect_choice_refused,
)
from joybridge.conformance.recording import act_request, step_bytes
from joybridge.conformance.registry import check
from joybridge.conformance.subject import Subject
from joybridge.contract.codec import pack
from joybridge.v1 import bridge_pb2 as pb


@check("Axis")
def axis_above_high_is_refused(subject: Subject) -> None:
    """The value of an axis is at most high."""
    expect_axis_refused(subject, lambda axis: np.nextafter(np.float32(axis.high), np.float32(np.inf)))


@check("Axis")
def axis_below_low_is_refused(subject: Subject) -> None:
    """The value of an axis is at least low."""
    expect_axis_refused(subject, lambda axis: np.nextafter(np.float32(axis.low), np.float32(-np.inf)))


@check("Axis")
def axis_far_out_of_range_is_refused(subject: Subject) -> None:
    """The value of an axis is in [low, high]; the server does not clip it."""
    expect_axis_refused(subject, lambda axis: np.float32(3e38))


@check("Tensor")
def nan_axis_is_refused(subject: Subject) -> None:
    """FLOAT32 values must be finite."""
    expect_axis_refused(subject, lambda axis: np.float32(np.nan), "axes")


@check("Tensor")
def infinite_axis_is_refused(subject: Subject) -> None:
    """FLOAT32 values must be finite."""
    expect_axis_refused(subject, lambda axis: np.float32(np.inf), "axes")
    expect_axis_refused(subject, lambda axis: np.float32(-np.inf), "axes")


@check("Axis")
def axis_at_low_or_high_is_accepted(subject: Subject) -> None:
    """The value of an axis is in [low, high], inclusive."""
    for prefix, act, index, _ in acts_with(subject, "axes"):
        device = subject.spec.behaviors[index].device
        for end in ("low", "high"):
            values = copy_actions(act, index, "axes")
            values[:] = [getattr(axis, end) for axis in device.axes]
            act.behaviors[index].axes.CopyFrom(pack(values))
            subject.expect_answered(*prefix, act_request(act))


@check("Axis")
def axis_without_its_choice_has_no_effect(subject: Subject) -> None:
    """An axis with `only_with` counts only in decisions with that choice."""
    recording = subject.short_session
    requests, idle_any = [*recording.requests], False
    for moment in range(1, len(requests)):
        act = pb.Act()
        act.CopyFrom(requests[moment].act)
        for index, behavior in enumerate(subject.spec.behaviors):
            branches = {branch.name: column for column, branch in enumerate(behavior.device.branches)}
            for column, axis in enumerate(behavior.device.axes):
                if not axis.HasField("only_with") or axis.only_with.branch not in branches:
                    continue
                axes, choices = copy_actions(act, index, "axes"), copy_actions(act, index, "choices")
                branch = branches[axis.only_with.branch]
                labels = behavior.device.branches[branch].choices
                idle = np.array(labels)[choices[:, branch]] != axis.only_with.choice
                axes[idle, column] = np.where(axes[idle, column] == np.float32(axis.high), axis.low, axis.high)
                act.behaviors[index].axes.CopyFrom(pack(axes))
                idle_any = idle_any or bool(idle.any())
        requests[moment] = act_request(act)
    skip_unless(idle_any, "every axis counts in every decision")
    got = [step_bytes(step) for step in subject.expect_steps(requests)]
    expect(
        got == recording.step_bytes, "different steps after other values of axes that do not count", "the same bytes"
    )


@check("Branch")
def negative_choice_is_refused(subject: Subject) -> None:
    """A discrete action is the index of a choice; negative indices do not count from the end."""
    expect_choice_refused(subject, lambda branch: -1)


@check("Branch")
def choice_after_the_last_is_refused(subject: Subject) -> None:
    """A discrete action is the index of a choice."""
    expect_choice_refused(subject, lambda branch: len(branch.choices))


@check("Branch")
def choice_far_out_of_range_is_refused(subject: Subject) -> None:
    """A discrete action is the index of a choice; the server does not take a remainder."""
    expect_choice_refused(subject, lambda branch: 2**31 - 1)
    expect_choice_refused(subject, lambda branch: -(2**31))


@check("BehaviorAct")
def masked_choice_is_refused(subject: Subject) -> None:
    """Each choice must be allowed by its mask."""
    found = False
    recording = subject.short_session
    for moment in range(len(recording.requests) - 1):
        for index, view in enumerate(recording.views(moment)):
            for column, branch in enumerate(view.behavior.device.branches):
                forbidden = np.argwhere(~view.allowed(column) & view.deciding[:, None])
                if forbidden.size:
                    found = True
                    lane, choice = forbidden[0]
                    act = pb.Act()
                    act.CopyFrom(recording.requests[moment + 1].act)
                    values = copy_actions(act, index, "choices")
                    values[lane, column] = choice
                    act.behaviors[index].choices.CopyFrom(pack(values))
                    words = [branch.name, "mask"]
                    subject.expect_refused(*recording.requests[: moment + 1], act_request(act), words=words)
                    break
        if found:
            return
    skip_unless(found, f"no choice is masked in the first {len(recording.requests) - 1} decisions")


@check("Act")
def invalid_action_in_the_last_lane_is_refused(subject: Subject) -> None:
    """The actions of every lane that decides must be valid."""
    for prefix, act, index in acts_of_each_behavior(subject):
        recording, behavior = subject.short_session, subject.spec.behaviors[index]
        lane = int(np.flatnonzero(recording.views(len(prefix) - 1)[index].deciding)[-1])
        device = behavior.device
        field = "axes" if device.axes else "choices"
        values = copy_actions(act, index, field)
        above = np.nextafter(np.float32(device.axes[-1].high), np.float32(np.inf)) if device.axes else -1
        values[lane, -1] = above
        getattr(act.behaviors[index], field).CopyFrom(pack(values))
        name = device.axes[-1].name if device.axes else device.branches[-1].name
        subject.expect_refused(*prefix, act_request(act), words=[name])


@check("BehaviorAct")
def actions_of_skipped_lanes_are_ignored(subject: Subject) -> None:
    """The actions of lanes that do not decide are ignored."""
    recording = subject.short_session
    requests = [*recording.requests]
    skipped_any = False
    for moment in range(1, len(requests)):
        act = pb.Act()
        act.CopyFrom(requests[moment].act)
        for index, view in enumerate(recording.views(moment - 1)):
            skipped = ~view.deciding
            skipped_any = skipped_any or bool(skipped.any())
            device = view.behavior.device
            if device.axes:
                axes = copy_actions(act, index, "axes")
                axes[skipped] = [axis.high for axis in device.axes]
                act.behaviors[index].axes.CopyFrom(pack(axes))
            if device.branches:
                choices = copy_actions(act, index, "choices")
                last = [view.allowed(b).shape[1] - 1 - np.argmax(view.allowed(b)[:, ::-1], axis=1)
                        for b in range(len(device.branches))]  # fmt: skip
                choices[skipped] = np.stack(last, axis=1)[skipped]
                act.behaviors[index].choices.CopyFrom(pack(choices))
        requests[moment] = act_request(act)
    skip_unless(skipped_any, "every lane decides in every step")
    got = [step_bytes(step) for step in subject.expect_steps(requests)]
    expect(got == recording.step_bytes, "different steps after other actions of skipped lanes", "the same bytes")
