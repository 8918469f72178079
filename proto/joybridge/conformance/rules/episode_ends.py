"""The ends of episodes in a long session: flags, final observations, metrics and the longest episode."""

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np

from joybridge.conformance.expectations import Suspicion, Violation, expect, skip_unless
from joybridge.conformance.registry import check, table
from joybridge.conformance.step_expectations import (
    expect_finite,
    expect_flags,
    expect_in_bounds,
    expect_observations,
    expect_tensor,
)
from joybridge.conformance.step_view import StepView, read_tensor
from joybridge.conformance.subject import Subject
from joybridge.contract.tensors import Array
from joybridge.v1 import bridge_pb2 as pb

SEVERAL = 3  # episodes that are hardly alike by chance


def _expect_one_flag(view: StepView) -> None:
    if view.terminated is not None and view.truncated is not None:
        both = np.flatnonzero(view.terminated & view.truncated)
        expect(not both.size, f"both flags in lanes {both.tolist()} of {view.where}", "at most one of the two")


def _expect_ended(view: StepView) -> None:
    present, ends = view.message.HasField("ended"), int(view.ended.sum())
    got = f"ended {'present' if present else 'absent'} with {ends} ended lanes of {view.where}"
    expect(present == bool(ends), got, "present if and only if a lane ended")


def _expect_lanes(view: StepView) -> None:
    expected = np.flatnonzero(view.ended).astype("<i4")
    expect_tensor(view.message.ended.lanes, pb.DTYPE_INT32, expected.shape, f"ended.lanes of {view.where}")
    got = np.frombuffer(view.message.ended.lanes.data, "<i4")
    expect((got == expected).all(), f"ended.lanes {got.tolist()} of {view.where}", expected.tolist())


def _expect_metrics(view: StepView) -> None:
    if view.behavior.metrics:
        shape = (int(view.ended.sum()), len(view.behavior.metrics))
        expect_tensor(view.message.ended.metrics, pb.DTYPE_FLOAT32, shape, f"metrics of {view.where}")


def _expect_finite_metrics(view: StepView) -> None:
    data = view.message.ended.metrics.data
    values = np.frombuffer(data[: len(data) // 4 * 4], "<f4")
    expect(np.isfinite(values).all(), f"metrics {values.tolist()} of {view.where}", "finite numbers")


def _expect_interrupted(view: StepView) -> None:
    message = view.message.ended
    if message.HasField("interrupted"):
        lanes = np.flatnonzero(view.ended)
        what = f"ended.interrupted of {view.where}"
        expect_tensor(message.interrupted, pb.DTYPE_BOOL, lanes.shape, what)
        cut = lanes[np.frombuffer(message.interrupted.data, bool)]
        if view.truncated is not None:
            wrong = cut[~view.truncated[cut]]
            expect(not wrong.size, f"{what} in lanes {wrong.tolist()} that are not truncated", "truncated lanes only")
        got = f"a game that failed in lanes {cut.tolist()} of {view.where}"
        expect(not cut.size, got, "no failure; the server's log should say more")


VIEWS = (  # name, section, rule, what each behavior of each step satisfies
    (
        "terminated_and_truncated_have_a_flag_per_lane",
        "BehaviorStep",
        "Terminated and truncated are BOOL [lanes], one byte per element, 0 or 1.",
        expect_flags,
    ),
    (
        "no_lane_is_terminated_and_truncated",
        "BehaviorStep",
        "An episode is terminated or truncated, never both.",
        _expect_one_flag,
    ),
    (
        "ended_is_present_exactly_when_an_episode_ended",
        "BehaviorStep",
        "Ended is absent if no episode of the behavior ended, and present otherwise.",
        _expect_ended,
    ),
)
ENDS = (  # name, section, rule, what each behavior of each step in which an episode ended satisfies
    (
        "ended_lanes_match_the_flags",
        "Ended",
        "Ended.lanes is INT32 [ended], ascending: exactly the terminated and truncated lanes.",
        _expect_lanes,
    ),
    (
        "final_observations_have_a_row_per_ended_lane",
        "Ended",
        "Final observations are one tensor per sensor, [ended, *shape].",
        partial(expect_observations, final=True),
    ),
    (
        "interrupted_has_a_flag_per_ended_lane",
        "Ended",
        "Interrupted is BOOL [ended], only for truncated lanes; in a game that does not fail it is absent or 0.",
        _expect_interrupted,
    ),
    ("final_observations_are_finite", "Tensor", "FLOAT32 values must be finite.", partial(expect_finite, final=True)),
    (
        "final_observations_are_in_bounds",
        "Sensor",
        "Low is the smallest value of a sensor and high the largest.",
        partial(expect_in_bounds, final=True),
    ),
)
METRICS = (  # the same, if a behavior has metrics
    ("metrics_have_a_row_per_ended_lane", "Ended", "Metrics are FLOAT32 [ended, metrics].", _expect_metrics),
    ("metrics_are_finite", "Tensor", "FLOAT32 values must be finite.", _expect_finite_metrics),
)


@table(VIEWS)
def _every_view_satisfies(subject: Subject, expectation: Callable[[StepView], None]) -> None:
    for view in subject.long_session.later:
        expectation(view)


@table(ENDS)
def _every_end_satisfies(subject: Subject, expectation: Callable[[StepView], None]) -> None:
    for view in _ends(subject):
        expectation(view)


@check("Ended")
def final_observations_belong_to_the_old_episode(subject: Subject) -> None:
    """Final observations are the last ones of the old episode; `observations` has the first ones of the new episode."""
    ends = list(_ends(subject))
    for index, behavior in enumerate(subject.spec.behaviors):
        own = [view for view in ends if view.behavior is behavior]
        finals = [row for view in own for row in _rows(view, final=True)]
        firsts = [row for view in own for row, ended in zip(_rows(view), view.ended, strict=False) if ended]
        if len(finals) < SEVERAL or finals != firsts or not _varies(subject, index):
            continue
        got = f"final observations of {behavior.name} that are the first ones of the new episode, {len(finals)} times"
        # A game may go on from where an episode was truncated, or return to its start in every episode.
        certain = len(set(finals)) > 1 and any(view.terminated is not None and view.terminated.any() for view in own)
        raise (Violation if certain else Suspicion)(got, "the last observations of the old episode")


@check("Ended")
def metrics_belong_to_the_old_episode(subject: Subject) -> None:
    """Metrics are numbers about the episode that ended, so they differ between episodes."""
    _require_metrics(subject)
    for behavior in subject.spec.behaviors:
        rows, lengths = [], []
        for view, ages in _ages(subject):
            shape = (int(view.ended.sum()), len(behavior.metrics))
            metrics = read_tensor(view.message.ended.metrics, pb.DTYPE_FLOAT32, shape)
            if view.behavior is behavior and metrics is not None:
                rows += metrics.tolist()
                lengths += ages[view.ended].tolist()
        same = len(lengths) >= SEVERAL and len(set(lengths)) > 1 and all(row == rows[0] for row in rows)
        if behavior.metrics and same:
            got = f"metrics {rows[0]} of {behavior.name} in all of {len(rows)} episodes of different lengths"
            raise Suspicion(got, "metrics of the episode that ended")


@table(METRICS)
def _metrics_of_every_end_satisfy(subject: Subject, expectation: Callable[[StepView], None]) -> None:
    _require_metrics(subject)
    _every_end_satisfies(subject, expectation)


@check("Ended")
def metrics_are_absent_without_metrics_in_the_spec(subject: Subject) -> None:
    """Metrics are absent if the behavior has none."""
    skip_unless(not all(behavior.metrics for behavior in subject.spec.behaviors), "every behavior has metrics")
    for view in _ends(subject):
        if not view.behavior.metrics:
            expect(not view.message.ended.HasField("metrics"), f"metrics of {view.where}", "none")


@check("GameSpec")
def episodes_are_not_longer_than_max_episode_decisions(subject: Subject) -> None:
    """An episode is truncated after max_episode_decisions at the latest."""
    longest = subject.spec.max_episode_decisions
    skip_unless(longest, "max_episode_decisions is 0: episodes have no limit")
    oldest = 0
    for view, ages in _ages(subject):
        over = (ages >= longest) & ~view.ended
        expect(not over.any(), f"an episode of more than {longest} decisions: {view.where}", "the end of the episode")
        oldest = max(oldest, int(ages.max()))
    skip_unless(oldest >= longest, f"no episode reached {longest} decisions; the longest has {oldest}")


def _require_metrics(subject: Subject) -> None:
    skip_unless(any(behavior.metrics for behavior in subject.spec.behaviors), "the game has no metrics")


def _ages(subject: Subject) -> Iterator[tuple[StepView, Array]]:
    """Yield each view with the number of decisions of the episode in each lane, including that of the view."""
    ages = {behavior.name: np.zeros(1, int) for behavior in subject.spec.behaviors}
    for view in subject.long_session.later:
        age = ages[view.behavior.name] + np.ones(view.lanes, int)
        yield view, age
        ages[view.behavior.name] = np.where(view.ended, 0, age)


def _rows(view: StepView, final: bool = False) -> list[bytes]:
    """Return the observations, or final observations, of each row as bytes."""
    columns = [values for _, values in view.observations(final)]
    return [b"".join(column[row].tobytes() for column in columns) for row in range(min(map(len, columns), default=0))]


def _varies(subject: Subject, behavior: int) -> bool:
    """Return whether the observations of a behavior change within a long session."""
    session = subject.long_session
    first = _rows(session.first[behavior])
    return any(_rows(session.views(index)[behavior]) != first for index in range(1, len(session.steps)))


def _ends(subject: Subject) -> Iterator[StepView]:
    """Yield the views in which an episode ended."""
    views = [view for view in subject.long_session.later if view.ended.any()]
    skip_unless(views, f"no episode ended in {len(subject.long_session.steps) - 1} decisions")
    yield from views
