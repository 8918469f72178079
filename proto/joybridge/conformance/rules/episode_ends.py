"""The ends of episodes in a long session: flags, final observations, metrics and the longest episode."""

from collections.abc import Iterator

import numpy as np

from joybridge.conformance.expectations import expect, skip_unless
from joybridge.conformance.registry import check
from joybridge.conformance.step_expectations import (
    expect_finite,
    expect_in_bounds,
    expect_observations,
    expect_tensor,
)
from joybridge.conformance.step_view import StepView
from joybridge.conformance.subject import Subject
from joybridge.v1 import bridge_pb2 as pb


@check("BehaviorStep")
def terminated_and_truncated_have_a_flag_per_lane(subject: Subject) -> None:
    """Terminated and truncated are BOOL [lanes], one byte per element, 0 or 1."""
    for view in subject.long_session.later:
        expect_tensor(view.message.terminated, pb.DTYPE_BOOL, (view.lanes,), f"terminated of {view.where}")
        expect_tensor(view.message.truncated, pb.DTYPE_BOOL, (view.lanes,), f"truncated of {view.where}")


@check("BehaviorStep")
def no_lane_is_terminated_and_truncated(subject: Subject) -> None:
    """An episode is terminated or truncated, never both."""
    for view in subject.long_session.later:
        if view.terminated is not None and view.truncated is not None:
            both = np.flatnonzero(view.terminated & view.truncated)
            expect(not both.size, f"both flags in lanes {both.tolist()} of {view.where}", "at most one of the two")


@check("BehaviorStep")
def ended_is_present_exactly_when_an_episode_ended(subject: Subject) -> None:
    """Ended is absent if no episode of the behavior ended, and present otherwise."""
    for view in subject.long_session.later:
        present, ends = view.message.HasField("ended"), int(view.ended.sum())
        got = f"ended {'present' if present else 'absent'} with {ends} ended lanes of {view.where}"
        expect(present == bool(ends), got, "present if and only if a lane ended")


@check("Ended")
def ended_lanes_match_the_flags(subject: Subject) -> None:
    """Ended.lanes is INT32 [ended], ascending: exactly the terminated and truncated lanes."""
    for view in _ends(subject):
        expected = np.flatnonzero(view.ended).astype("<i4")
        expect_tensor(view.message.ended.lanes, pb.DTYPE_INT32, expected.shape, f"ended.lanes of {view.where}")
        got = np.frombuffer(view.message.ended.lanes.data, "<i4")
        expect((got == expected).all(), f"ended.lanes {got.tolist()} of {view.where}", expected.tolist())


@check("Ended")
def final_observations_have_a_row_per_ended_lane(subject: Subject) -> None:
    """Final observations are one tensor per sensor, [ended, *shape]."""
    for view in _ends(subject):
        tensors = view.message.ended.final_observations
        expect_observations(tensors, view, int(view.ended.sum()), "final observations")


@check("Tensor")
def final_observations_are_finite(subject: Subject) -> None:
    """FLOAT32 values must be finite."""
    for view in _ends(subject):
        expect_finite(view, final=True)


@check("Sensor")
def final_observations_are_in_bounds(subject: Subject) -> None:
    """Low is the smallest value of a sensor and high the largest."""
    for view in _ends(subject):
        expect_in_bounds(view, final=True)


@check("Ended")
def metrics_have_a_row_per_ended_lane(subject: Subject) -> None:
    """Metrics are FLOAT32 [ended, metrics]."""
    skip_unless(any(behavior.metrics for behavior in subject.spec.behaviors), "the game has no metrics")
    for view in _ends(subject):
        if view.behavior.metrics:
            shape = (int(view.ended.sum()), len(view.behavior.metrics))
            expect_tensor(view.message.ended.metrics, pb.DTYPE_FLOAT32, shape, f"metrics of {view.where}")


@check("Ended")
def metrics_are_absent_without_metrics_in_the_spec(subject: Subject) -> None:
    """Metrics are absent if the behavior has none."""
    skip_unless(not all(behavior.metrics for behavior in subject.spec.behaviors), "every behavior has metrics")
    for view in _ends(subject):
        if not view.behavior.metrics:
            expect(not view.message.ended.HasField("metrics"), f"metrics of {view.where}", "none")


@check("Tensor")
def metrics_are_finite(subject: Subject) -> None:
    """FLOAT32 values must be finite."""
    skip_unless(any(behavior.metrics for behavior in subject.spec.behaviors), "the game has no metrics")
    for view in _ends(subject):
        data = view.message.ended.metrics.data
        values = np.frombuffer(data[: len(data) // 4 * 4], "<f4")
        expect(np.isfinite(values).all(), f"metrics {values.tolist()} of {view.where}", "finite numbers")


@check("GameSpec")
def episodes_are_not_longer_than_max_episode_decisions(subject: Subject) -> None:
    """An episode is truncated after max_episode_decisions at the latest."""
    longest = subject.spec.max_episode_decisions
    skip_unless(longest, "max_episode_decisions is 0: episodes have no limit")
    lengths = {behavior.name: np.zeros(1, int) for behavior in subject.spec.behaviors}
    for view in subject.long_session.later:
        name = view.behavior.name
        lengths[name] = lengths[name] + 1
        over = (lengths[name] >= longest) & ~view.ended
        expect(not over.any(), f"an episode of more than {longest} decisions: {view.where}", "the end of the episode")
        lengths[name] = np.where(view.ended, 0, lengths[name])


def _ends(subject: Subject) -> Iterator[StepView]:
    """Yield the views in which an episode ended."""
    views = [view for view in subject.long_session.later if view.ended.any()]
    skip_unless(views, f"no episode ended in {len(subject.long_session.steps) - 1} decisions")
    yield from views
