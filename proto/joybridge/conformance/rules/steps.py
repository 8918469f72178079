"""Every step of a long session: observations, rewards, masks and deciding. Ends of episodes are in `episode_ends`."""

import math
from collections.abc import Callable

from joybridge.conformance.expectations import expect, skip_unless
from joybridge.conformance.registry import check, table
from joybridge.conformance.step_expectations import (
    expect_deciding,
    expect_finite,
    expect_finite_rewards,
    expect_in_bounds,
    expect_masks,
    expect_observations,
    expect_rewards,
)
from joybridge.conformance.step_view import StepView
from joybridge.conformance.subject import Subject
from joybridge.v1 import bridge_pb2 as pb


def _counted(count: int, expected: int, what: str) -> None:
    expect(count == expected, f"{count} {what}", expected or "none")


def _clocked(seconds: float) -> None:
    expect(math.isfinite(seconds) and seconds >= 0, f"simulate_seconds {seconds}", "a finite number, at least 0")


STEPS = (  # name, section, rule, what each step satisfies under the spec
    (
        "every_step_has_every_behavior",
        "Step",
        "A step has one BehaviorStep per behavior of the spec.",
        lambda step, spec: _counted(len(step.behaviors), len(spec.behaviors), "behaviors"),
    ),
    (
        "step_without_draw_has_no_pictures",
        "Step",
        "A step has one picture per arena in Act.draw.",
        lambda step, spec: _counted(len(step.pictures), 0, "pictures"),
    ),
    (
        "simulate_seconds_is_not_negative",
        "Step",
        "simulate_seconds is the wall-clock time that the game took for the step.",
        lambda step, spec: _clocked(step.simulate_seconds),
    ),
)
VIEWS = (  # name, section, rule, what each behavior of each step satisfies
    (
        "observations_match_the_sensors",
        "BehaviorStep",
        "Observations are one tensor per sensor, [lanes, *shape].",
        expect_observations,
    ),
    ("observations_are_finite", "Tensor", "FLOAT32 values must be finite.", expect_finite),
    (
        "observations_are_in_bounds",
        "Sensor",
        "Low is the smallest value of a sensor and high the largest.",
        expect_in_bounds,
    ),
    ("rewards_have_a_column_per_channel", "BehaviorStep", "Rewards are FLOAT32 [lanes, channels].", expect_rewards),
    ("rewards_are_finite", "Tensor", "FLOAT32 values must be finite.", expect_finite_rewards),
)
OPTIONAL = (  # name, section, rule, what each behavior satisfies, whether it has it, the reason to skip the check
    (
        "masks_are_valid",
        "BehaviorStep",
        "Masks are one BOOL [lanes, choices] per branch, or none; every lane has an allowed choice.",
        expect_masks,
        lambda message: message.masks,
        "the game has no masks",
    ),
    (
        "deciding_has_a_flag_per_lane",
        "BehaviorStep",
        "Deciding is BOOL [lanes], or absent if every lane decides.",
        expect_deciding,
        lambda message: message.HasField("deciding"),
        "every lane decides in every step",
    ),
)


@check("Act")
def valid_actions_are_answered(subject: Subject) -> None:
    """The response to a valid Act is a Step."""
    recording = subject.long_session
    expect(recording.end is None, f"{recording.end} after {len(recording.steps)} responses", "a Step")


@table(STEPS)
def _every_step_satisfies(subject: Subject, expectation: Callable[[pb.Step, pb.GameSpec], None]) -> None:
    for step in subject.long_session.steps[1:]:
        expectation(step, subject.spec)


@table(VIEWS)
def _every_view_satisfies(subject: Subject, expectation: Callable[[StepView], None]) -> None:
    for view in subject.long_session.later:
        expectation(view)


@check("BehaviorStep")
def rewards_of_skipped_lanes_are_zero(subject: Subject) -> None:
    """The rewards of a lane are 0 while it is skipped; it gets their sum when it decides again or its episode ends."""
    skipped_any = False
    for view in subject.long_session.later:
        rewards, skipped = view.rewards, ~(view.deciding | view.ended)
        skipped_any = skipped_any or bool(skipped.any())
        if rewards is not None:
            got = f"rewards {rewards[skipped].tolist()} of skipped lanes of {view.where}"
            expect(not rewards[skipped].any(), got, "zeros")
    skip_unless(skipped_any, "every lane decides in every step")


@table(OPTIONAL)
def _every_view_that_has_it_satisfies(
    subject: Subject,
    expectation: Callable[[StepView], None],
    has: Callable[[pb.BehaviorStep], object],
    reason: str,
) -> None:
    skip_unless(any(has(view.message) for view in subject.long_session.later), reason)
    _every_view_satisfies(subject, expectation)
