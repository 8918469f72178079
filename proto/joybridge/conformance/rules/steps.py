"""Every step of a long session: observations, rewards, masks and deciding. Ends of episodes are in `episode_ends`."""

import math

import numpy as np

from joybridge.conformance.expectations import expect, skip_unless
from joybridge.conformance.registry import check
from joybridge.conformance.step_expectations import (
    expect_deciding,
    expect_finite,
    expect_in_bounds,
    expect_masks,
    expect_observations,
    expect_tensor,
)
from joybridge.conformance.subject import Subject
from joybridge.v1 import bridge_pb2 as pb


@check("Act")
def valid_actions_are_answered(subject: Subject) -> None:
    """The response to a valid Act is a Step."""
    recording = subject.long_session
    expect(recording.end is None, f"{recording.end} after {len(recording.steps)} responses", "a Step")


@check("Step")
def every_step_has_every_behavior(subject: Subject) -> None:
    """A step has one BehaviorStep per behavior of the spec."""
    expected = len(subject.spec.behaviors)
    for step in subject.long_session.steps[1:]:
        expect(len(step.behaviors) == expected, f"{len(step.behaviors)} behaviors", expected)


@check("Step")
def step_without_draw_has_no_pictures(subject: Subject) -> None:
    """A step has one picture per arena in Act.draw."""
    for step in subject.long_session.steps[1:]:
        expect(not step.pictures, f"{len(step.pictures)} pictures", "none")


@check("Step")
def simulate_seconds_is_not_negative(subject: Subject) -> None:
    """simulate_seconds is the wall-clock time that the game took for the step."""
    for step in subject.long_session.steps:
        seconds = step.simulate_seconds
        expect(math.isfinite(seconds) and seconds >= 0, f"simulate_seconds {seconds}", "a finite number, at least 0")


@check("BehaviorStep")
def observations_match_the_sensors(subject: Subject) -> None:
    """Observations are one tensor per sensor, [lanes, *shape]."""
    for view in subject.long_session.later:
        expect_observations(view.message.observations, view, view.lanes, "observations")


@check("Tensor")
def observations_are_finite(subject: Subject) -> None:
    """FLOAT32 values must be finite."""
    for view in subject.long_session.later:
        expect_finite(view)


@check("Sensor")
def observations_are_in_bounds(subject: Subject) -> None:
    """Low is the smallest value of a sensor and high the largest."""
    for view in subject.long_session.later:
        expect_in_bounds(view)


@check("BehaviorStep")
def rewards_have_a_column_per_channel(subject: Subject) -> None:
    """Rewards are FLOAT32 [lanes, channels]."""
    for view in subject.long_session.later:
        shape = (view.lanes, len(view.behavior.channels))
        expect_tensor(view.message.rewards, pb.DTYPE_FLOAT32, shape, f"rewards of {view.where}")


@check("Tensor")
def rewards_are_finite(subject: Subject) -> None:
    """FLOAT32 values must be finite."""
    for view in subject.long_session.later:
        rewards = view.rewards
        if rewards is not None:
            expect(np.isfinite(rewards).all(), f"rewards {rewards.tolist()} of {view.where}", "finite numbers")


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


@check("BehaviorStep")
def masks_are_valid(subject: Subject) -> None:
    """Masks are one BOOL [lanes, choices] per branch, or none; every lane has an allowed choice."""
    skip_unless(any(view.message.masks for view in subject.long_session.later), "the game has no masks")
    for view in subject.long_session.later:
        expect_masks(view)


@check("BehaviorStep")
def deciding_has_a_flag_per_lane(subject: Subject) -> None:
    """Deciding is BOOL [lanes], or absent if every lane decides."""
    views = subject.long_session.later
    skip_unless(any(view.message.HasField("deciding") for view in views), "every lane decides in every step")
    for view in views:
        expect_deciding(view)
