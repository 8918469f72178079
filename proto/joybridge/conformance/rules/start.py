"""Start: its response, and the first step of a session."""

from collections.abc import Callable

from joybridge.conformance.expectations import expect, expect_equal, skip_unless
from joybridge.conformance.registry import check, table
from joybridge.conformance.step_expectations import (
    expect_deciding,
    expect_finite,
    expect_flags,
    expect_in_bounds,
    expect_masks,
    expect_no_ends,
    expect_no_rewards,
    expect_observations,
    expect_rewards,
)
from joybridge.conformance.step_view import StepView
from joybridge.conformance.subject import Subject

MANY_ARENAS = 65_536  # of a session that is started; a game may have more
FIRST = (  # name, section, rule, what each behavior of the first step satisfies
    ("first_observations_match_the_sensors", "BehaviorStep",
     "Observations are one tensor per sensor, [lanes, *shape].", expect_observations),
    ("first_observations_are_finite", "Tensor", "FLOAT32 values must be finite.", expect_finite),
    ("first_observations_are_in_bounds", "Sensor",
     "Low is the smallest value of a sensor and high the largest.", expect_in_bounds),
    ("first_rewards_are_zero", "Started",
     "In the first step of a session all rewards are 0.", expect_rewards, expect_no_rewards),
    ("first_step_ends_no_episode", "Started",
     "In the first step of a session no episode has ended.", expect_flags, expect_no_ends),
    ("first_masks_are_valid", "BehaviorStep",
     "Masks are one BOOL [lanes, choices] per branch, or none; every lane has an allowed choice.", expect_masks),
    ("first_deciding_is_valid", "BehaviorStep",
     "Deciding is BOOL [lanes], or absent if every lane decides.", expect_deciding),
)  # fmt: skip
ARENAS = (  # name, section, rule, number of arenas at most
    ("one_arena_can_be_started", "Start", "A session has 1 arena or more, and each tensor has one row per lane.", 1),
    ("max_arenas_can_be_started", "Start", "A session may have as many as max_arenas arenas.", MANY_ARENAS),
)


@check("Started")
def start_is_answered_by_started(subject: Subject) -> None:
    """The response to Start is Started, with a spec and the first step."""
    (response,) = subject.expect_answered(subject.start())
    expect_equal(response.WhichOneof("response"), "started", "the response")
    for field in ("spec", "step"):
        expect(response.started.HasField(field), f"Started without {field}", "Started with a spec and a step")


@check("Started")
def started_has_the_spec_of_describe(subject: Subject) -> None:
    """The spec in Started is the one that DescribeGame returns for the same options."""
    started = subject.short_session.started
    same = started is not None and started.spec == subject.spec
    expect(same, "a different spec", "the spec of DescribeGame")


@check("Started")
def started_has_the_spec_of_describe_for_every_choice(subject: Subject) -> None:
    """A session can start with every choice of every option, and Started has the spec of DescribeGame for it."""
    skip_unless(subject.spec.options, "the game has no options")
    for chosen in ({option.name: choice} for option in subject.spec.options for choice in option.choices):
        (response,) = subject.expect_answered(subject.start(options=chosen))
        same = response.started.spec == subject.client.describe(subject.game, chosen)
        expect(same, f"a different spec with {chosen}", "the spec of DescribeGame")


@check("Step")
def first_step_has_every_behavior(subject: Subject) -> None:
    """A step has one BehaviorStep per behavior of the spec."""
    got, expected = len(subject.short_session.steps[0].behaviors), len(subject.spec.behaviors)
    expect(got == expected, f"{got} behaviors", expected)


@check("Step")
def first_step_has_no_pictures(subject: Subject) -> None:
    """A step has one picture per arena in Act.draw, so the first step has none."""
    pictures = subject.short_session.steps[0].pictures
    expect(not pictures, f"{len(pictures)} pictures", "none")


@table(FIRST)
def _first_step_satisfies(subject: Subject, *expectations: Callable[[StepView], None]) -> None:
    for view in subject.short_session.first:
        for expectation in expectations:
            expectation(view)


@table(ARENAS)
def _can_be_started(subject: Subject, most: int) -> None:
    arenas = min(subject.spec.max_arenas, most) if most > 1 else most
    (response,) = subject.expect_answered(subject.start(arenas))
    for step, behavior in zip(response.started.step.behaviors, subject.spec.behaviors, strict=False):
        got, expected = list(step.terminated.shape), [arenas * behavior.agents_per_arena]
        expect(got == expected, f"terminated of shape {got} of {behavior.name} with {arenas} arenas", expected)
