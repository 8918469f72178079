"""What every step of a play must be, looked at in a recorded one."""

import math
from collections.abc import Iterator

import numpy as np

from joybridge.conformance.reading import Part, expect_bounded, expect_finite, expect_fit, expect_sensed
from joybridge.conformance.registry import check, expect, needs
from joybridge.conformance.subject import Subject
from joybridge.v1 import bridge_pb2 as pb


@check("Act")
def legal_actions_are_answered(subject: Subject) -> None:
    """Act advances every arena by one decision and is answered by Step."""
    recording = subject.long
    expect(recording.end is None, f"{recording.end} after {len(recording.steps)} answers", "a step")


@check("Step")
def every_step_has_every_behavior(subject: Subject) -> None:
    """A step has one BehaviorStep per behavior of the spec."""
    wanted = len(subject.spec.behaviors)
    for step in subject.long.steps[1:]:
        expect(len(step.behaviors) == wanted, f"{len(step.behaviors)} behaviors", wanted)


@check("Step")
def a_step_without_drawing_has_no_pictures(subject: Subject) -> None:
    """There is one picture per arena in Act.draw."""
    for step in subject.long.steps[1:]:
        expect(not step.pictures, f"{len(step.pictures)} pictures", "none")


@check("Step")
def the_time_of_a_step_is_not_negative(subject: Subject) -> None:
    """simulate_seconds is the wall-clock time the game took for this step."""
    for step in subject.long.steps:
        seconds = step.simulate_seconds
        expect(math.isfinite(seconds) and seconds >= 0, f"simulate_seconds {seconds}", "a finite number, at least 0")


@check("BehaviorStep")
def observations_have_the_shape_of_their_sensors(subject: Subject) -> None:
    """Observations are one tensor per sensor, [lanes, *shape]."""
    for part in subject.long.later:
        expect_sensed(part.message.observations, part, part.lanes, "observations")


@check("Tensor")
def observations_are_finite(subject: Subject) -> None:
    """FLOAT32 values must be finite."""
    for part in subject.long.later:
        expect_finite(part)


@check("Sensor")
def observations_lie_within_their_bounds(subject: Subject) -> None:
    """Low is the smallest value of a sensor and high the largest."""
    for part in subject.long.later:
        expect_bounded(part)


@check("BehaviorStep")
def rewards_have_a_column_per_channel(subject: Subject) -> None:
    """Rewards are FLOAT32 [lanes, channels]."""
    for part in subject.long.later:
        shape = (part.lanes, len(part.behavior.channels))
        expect_fit(part.message.rewards, pb.DTYPE_FLOAT32, shape, f"rewards of {part.where}")


@check("Tensor")
def rewards_are_finite(subject: Subject) -> None:
    """FLOAT32 values must be finite."""
    for part in subject.long.later:
        rewards = part.rewards
        if rewards is not None:
            expect(np.isfinite(rewards).all(), f"rewards {rewards.tolist()} of {part.where}", "finite numbers")


@check("BehaviorStep")
def lanes_that_are_skipped_are_paid_nothing_yet(subject: Subject) -> None:
    """Rewards are reported when the lane decides again or its episode ends; they are 0 while it is skipped."""
    waited = False
    for part in subject.long.later:
        rewards, skipped = part.rewards, ~(part.deciding | part.ended)
        waited = waited or bool(skipped.any())
        if rewards is not None:
            expect(not rewards[skipped].any(), f"{rewards[skipped].tolist()} of {part.where}", "zeros for who waits")
    needs(waited, "every lane always decides")


@check("BehaviorStep")
def terminated_and_truncated_have_a_flag_per_lane(subject: Subject) -> None:
    """Terminated and truncated are BOOL [lanes], one byte per element, 0 or 1."""
    for part in subject.long.later:
        expect_fit(part.message.terminated, pb.DTYPE_BOOL, (part.lanes,), f"terminated of {part.where}")
        expect_fit(part.message.truncated, pb.DTYPE_BOOL, (part.lanes,), f"truncated of {part.where}")


@check("BehaviorStep")
def no_lane_is_terminated_and_truncated_at_once(subject: Subject) -> None:
    """The two ends are never mixed."""
    for part in subject.long.later:
        if part.terminated is not None and part.truncated is not None:
            both = np.flatnonzero(part.terminated & part.truncated)
            expect(not both.size, f"both in lanes {both.tolist()} of {part.where}", "at most one of the two")


@check("BehaviorStep")
def ended_is_there_exactly_when_an_episode_ended(subject: Subject) -> None:
    """Ended is absent where no episode of this behavior ended."""
    for part in subject.long.later:
        came = "an" if part.message.HasField("ended") else "no"
        holds = part.message.HasField("ended") == bool(part.ended.any())
        expect(holds, f"{came} ended with {part.ended.sum()} ends of {part.where}", "ended where something ended")


@check("Ended")
def ended_lists_exactly_the_lanes_that_ended(subject: Subject) -> None:
    """Ended.lanes is INT32 [ended], ascending: exactly those terminated or truncated."""
    for part in _ends(subject):
        wanted = np.flatnonzero(part.ended).astype("<i4")
        expect_fit(part.message.ended.lanes, pb.DTYPE_INT32, wanted.shape, f"ended.lanes of {part.where}")
        came = np.frombuffer(part.message.ended.lanes.data, "<i4")
        expect((came == wanted).all(), f"ended.lanes {came.tolist()} of {part.where}", wanted.tolist())


@check("Ended")
def final_observations_have_a_row_per_end(subject: Subject) -> None:
    """Final observations are one tensor per sensor, [ended, *shape]."""
    for part in _ends(subject):
        expect_sensed(part.message.ended.final_observations, part, int(part.ended.sum()), "final observations")


@check("Tensor")
def final_observations_are_finite(subject: Subject) -> None:
    """FLOAT32 values must be finite."""
    for part in _ends(subject):
        expect_finite(part, final=True)


@check("Sensor")
def final_observations_lie_within_their_bounds(subject: Subject) -> None:
    """Low is the smallest value of a sensor and high the largest."""
    for part in _ends(subject):
        expect_bounded(part, final=True)


@check("Ended")
def metrics_have_a_row_per_end(subject: Subject) -> None:
    """Metrics are FLOAT32 [ended, metrics]."""
    needs(any(behavior.metrics for behavior in subject.spec.behaviors), "the game has no metrics")
    for part in _ends(subject):
        if part.behavior.metrics:
            shape = (int(part.ended.sum()), len(part.behavior.metrics))
            expect_fit(part.message.ended.metrics, pb.DTYPE_FLOAT32, shape, f"metrics of {part.where}")


@check("Ended")
def a_behavior_without_metrics_reports_none(subject: Subject) -> None:
    """Metrics are absent if the behavior has none."""
    needs(not all(behavior.metrics for behavior in subject.spec.behaviors), "every behavior has metrics")
    for part in _ends(subject):
        if not part.behavior.metrics:
            expect(not part.message.ended.HasField("metrics"), f"metrics of {part.where}", "none")


@check("Tensor")
def metrics_are_finite(subject: Subject) -> None:
    """FLOAT32 values must be finite."""
    needs(any(behavior.metrics for behavior in subject.spec.behaviors), "the game has no metrics")
    for part in _ends(subject):
        data = part.message.ended.metrics.data
        values = np.frombuffer(data[: len(data) // 4 * 4], "<f4")
        expect(np.isfinite(values).all(), f"metrics {values.tolist()} of {part.where}", "finite numbers")


@check("GameSpec")
def no_episode_is_longer_than_the_spec_says(subject: Subject) -> None:
    """An episode is truncated at max_episode_decisions at the latest."""
    longest = subject.spec.max_episode_decisions
    needs(longest, "the game has no limit")
    lengths = {behavior.name: np.zeros(1, int) for behavior in subject.spec.behaviors}
    for part in subject.long.later:
        name = part.behavior.name
        lengths[name] = lengths[name] + 1
        over = (lengths[name] >= longest) & ~part.ended
        expect(not over.any(), f"an episode that goes on after {longest} decisions: {part.where}", "an end")
        lengths[name] = np.where(part.ended, 0, lengths[name])


@check("BehaviorStep")
def masks_have_a_column_per_choice_and_allow_one(subject: Subject) -> None:
    """Masks are BOOL [lanes, choices] per branch, or none; a lane always has something to choose."""
    needs(any(part.message.masks for part in subject.long.later), "the game has no masks")
    for part in subject.long.later:
        expect_masks(part)


@check("BehaviorStep")
def deciding_has_a_flag_per_lane(subject: Subject) -> None:
    """Deciding is BOOL [lanes], or absent where every lane decides."""
    needs(any(part.message.HasField("deciding") for part in subject.long.later), "every lane always decides")
    for part in subject.long.later:
        expect_deciding(part)


def expect_masks(part: Part) -> None:
    """Raise Broken unless the masks of a part fit its branches and always allow a choice."""
    masks, branches = part.message.masks, part.behavior.device.branches
    expect(len(masks) in (0, len(branches)), f"{len(masks)} masks of {part.where}", f"0 or {len(branches)}")
    for index, (mask, branch) in enumerate(zip(masks, branches, strict=False)):
        expect_fit(mask, pb.DTYPE_BOOL, (part.lanes, len(branch.choices)), f"mask of {branch.name!r} of {part.where}")
        stuck = np.flatnonzero(~part.allowed(index).any(axis=1))
        came = f"no choice of {branch.name!r} allowed in lanes {stuck.tolist()} of {part.where}"
        expect(not stuck.size, came, "at least one")


def expect_deciding(part: Part) -> None:
    """Raise Broken unless deciding is absent or has a flag per lane."""
    if part.message.HasField("deciding"):
        expect_fit(part.message.deciding, pb.DTYPE_BOOL, (part.lanes,), f"deciding of {part.where}")


def _ends(subject: Subject) -> Iterator[Part]:
    """Yield the parts in which something ended."""
    parts = [part for part in subject.long.later if part.ended.any()]
    needs(parts, f"no episode ended in {len(subject.long.steps) - 1} decisions")
    yield from parts
