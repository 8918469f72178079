"""Values of actions: invalid ones are refused with INVALID_ARGUMENT and a text that names the axis or branch."""

from collections.abc import Callable
from typing import Any

import numpy as np

from joybridge.conformance.expectations import NotApplicable, expect, skip_unless
from joybridge.conformance.invalid_acts import PARTS, acts_of_each_behavior, acts_with, changed, read
from joybridge.conformance.recording import act_request, step_bytes
from joybridge.conformance.registry import check, table
from joybridge.conformance.subject import Subject
from joybridge.contract.codec import pack
from joybridge.v1 import bridge_pb2 as pb


def _above(axis: pb.Axis) -> float:
    with np.errstate(over="ignore"):  # above the largest float is infinity
        return float(np.nextafter(np.float32(axis.high), np.float32(np.inf)))


def _below(axis: pb.Axis) -> float:
    with np.errstate(over="ignore"):
        return float(np.nextafter(np.float32(axis.low), np.float32(-np.inf)))


INVALID = (  # name, section, rule, field of BehaviorAct, values for one axis or branch, words beside its name
    ("axis_above_high_is_refused", "Axis", "The value of an axis is at most high.", "axes", lambda a: [_above(a)]),
    ("axis_below_low_is_refused", "Axis", "The value of an axis is at least low.", "axes", lambda a: [_below(a)]),
    ("axis_far_out_of_range_is_refused", "Axis",
     "The value of an axis is in [low, high]; the server does not clip it.", "axes", lambda a: [3e38]),
    ("nan_axis_is_refused", "Tensor", "FLOAT32 values must be finite.", "axes", lambda a: [np.nan], "axes"),
    ("infinite_axis_is_refused", "Tensor", "FLOAT32 values must be finite.",
     "axes", lambda a: [np.inf, -np.inf], "axes"),
    ("negative_choice_is_refused", "Branch",
     "A discrete action is the index of a choice; negative indices do not count from the end.",
     "choices", lambda b: [-1]),
    ("choice_after_the_last_is_refused", "Branch",
     "A discrete action is the index of a choice.", "choices", lambda b: [len(b.choices)]),
    ("choice_far_out_of_range_is_refused", "Branch",
     "A discrete action is the index of a choice; the server does not take a remainder.",
     "choices", lambda b: [2**31 - 1, -(2**31)]),
)  # fmt: skip


@table(INVALID)
def _value_is_refused(subject: Subject, field: str, values: Callable[[Any], list[float]], *words: str) -> None:
    for prefix, act, index, lane in acts_with(subject, field):
        for column, part in enumerate(getattr(subject.spec.behaviors[index].device, PARTS[field])):
            low, high = (part.low, part.high) if field == "axes" else (0, len(part.choices) - 1)
            # What lies beyond all floats is refused as not finite, with the name of the tensor.
            wanted = [v for v in values(part) if not low <= v <= high and (np.isfinite(v) or "axes" in words)]
            for value in wanted:
                invalid = read(getattr(act.behaviors[index], field))
                invalid[lane, column] = value
                subject.expect_refused(*prefix, changed(act, index, field, invalid), words=[part.name, *words])


@check("Axis")
def axis_at_low_or_high_is_accepted(subject: Subject) -> None:
    """The value of an axis is in [low, high], inclusive."""
    for prefix, act, index, _ in acts_with(subject, "axes"):
        for end in ("low", "high"):
            values = read(act.behaviors[index].axes)
            values[:] = [getattr(axis, end) for axis in subject.spec.behaviors[index].device.axes]
            subject.expect_answered(*prefix, changed(act, index, "axes", values))


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
                axes, choices = read(act.behaviors[index].axes), read(act.behaviors[index].choices)
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


@check("BehaviorAct")
def masked_choice_is_refused(subject: Subject) -> None:
    """Each choice must be allowed by its mask."""
    recording = subject.short_session
    for moment, request in enumerate(recording.requests[1:]):
        found = False
        for index, view in enumerate(recording.views(moment)):
            for column, branch in enumerate(view.behavior.device.branches):
                forbidden = np.argwhere(~view.allowed(column) & view.deciding[:, None])
                if forbidden.size:
                    found = True
                    lane, choice = forbidden[0]
                    values = read(request.act.behaviors[index].choices)
                    values[lane, column] = choice
                    invalid = changed(request.act, index, "choices", values)
                    subject.expect_refused(*recording.requests[: moment + 1], invalid, words=[branch.name, "mask"])
                    break
        if found:
            return
    raise NotApplicable(f"no choice is masked in the first {len(recording.requests) - 1} decisions")


@check("Act")
def invalid_action_in_the_last_lane_is_refused(subject: Subject) -> None:
    """The actions of every lane that decides must be valid."""
    for prefix, act, index in acts_of_each_behavior(subject):
        lane = int(np.flatnonzero(subject.short_session.views(len(prefix) - 1)[index].deciding)[-1])
        device = subject.spec.behaviors[index].device
        field, value = ("axes", _above(device.axes[-1])) if device.axes else ("choices", -1)
        values = read(getattr(act.behaviors[index], field))
        values[lane, -1] = value
        name = getattr(device, PARTS[field])[-1].name if np.isfinite(value) else field
        subject.expect_refused(*prefix, changed(act, index, field, values), words=[name])


@check("BehaviorAct")
def actions_of_skipped_lanes_are_ignored(subject: Subject) -> None:
    """The actions of lanes that do not decide are ignored."""
    recording = subject.short_session
    requests = [*recording.requests]
    skipped_any = False
    for moment in range(1, len(requests)):
        requests[moment] = act_request(requests[moment].act)
        for view, action in zip(recording.views(moment - 1), requests[moment].act.behaviors, strict=True):
            skipped = ~view.deciding
            skipped_any = skipped_any or bool(skipped.any())
            device = view.behavior.device
            if device.axes:
                axes = read(action.axes)
                axes[skipped] = [axis.high for axis in device.axes]
                action.axes.CopyFrom(pack(axes))
            if device.branches:
                choices = read(action.choices)
                for column in range(len(device.branches)):
                    allowed = view.allowed(column)[skipped, ::-1]
                    choices[skipped, column] = allowed.shape[1] - 1 - np.argmax(allowed, axis=1)  # the last one
                action.choices.CopyFrom(pack(choices))
    skip_unless(skipped_any, "every lane decides in every step")
    got = [step_bytes(step) for step in subject.expect_steps(requests)]
    expect(got == recording.step_bytes, "different steps after other actions of skipped lanes", "the same bytes")
