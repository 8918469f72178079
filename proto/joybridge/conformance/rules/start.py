"""Start: its response, and the first step of a session."""

from joybridge.conformance.expectations import expect, expect_equal, skip_unless
from joybridge.conformance.registry import check
from joybridge.conformance.step_expectations import (
    expect_deciding,
    expect_finite,
    expect_in_bounds,
    expect_masks,
    expect_no_ends,
    expect_no_rewards,
    expect_observations,
    expect_tensor,
)
from joybridge.conformance.subject import Subject
from joybridge.v1 import bridge_pb2 as pb


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
    for option in subject.spec.options:
        for choice in option.choices:
            chosen = {option.name: choice}
            (response,) = subject.expect_answered(subject.start(options=chosen))
            same = response.started.spec == subject.client.describe(subject.game, chosen)
            expect(same, f"a different spec with {chosen}", "the spec of DescribeGame")


@check("Step")
def first_step_has_every_behavior(subject: Subject) -> None:
    """A step has one BehaviorStep per behavior of the spec."""
    got, expected = len(subject.short_session.steps[0].behaviors), len(subject.spec.behaviors)
    expect(got == expected, f"{got} behaviors", expected)


@check("BehaviorStep")
def first_observations_match_the_sensors(subject: Subject) -> None:
    """Observations are one tensor per sensor, [lanes, *shape]."""
    for view in subject.short_session.first:
        expect_observations(view.message.observations, view, view.lanes, "observations")


@check("Tensor")
def first_observations_are_finite(subject: Subject) -> None:
    """FLOAT32 values must be finite."""
    for view in subject.short_session.first:
        expect_finite(view)


@check("Sensor")
def first_observations_are_in_bounds(subject: Subject) -> None:
    """Low is the smallest value of a sensor and high the largest."""
    for view in subject.short_session.first:
        expect_in_bounds(view)


@check("Started")
def first_rewards_are_zero(subject: Subject) -> None:
    """In the first step of a session all rewards are 0."""
    for view in subject.short_session.first:
        expect_tensor(view.message.rewards, pb.DTYPE_FLOAT32, (view.lanes, len(view.behavior.channels)), "rewards")
        expect_no_rewards(view)


@check("Started")
def first_step_ends_no_episode(subject: Subject) -> None:
    """In the first step of a session no episode has ended."""
    for view in subject.short_session.first:
        for flags, what in ((view.message.terminated, "terminated"), (view.message.truncated, "truncated")):
            expect_tensor(flags, pb.DTYPE_BOOL, (view.lanes,), what)
        expect_no_ends(view)


@check("Step")
def first_step_has_no_pictures(subject: Subject) -> None:
    """A step has one picture per arena in Act.draw, so the first step has none."""
    pictures = subject.short_session.steps[0].pictures
    expect(not pictures, f"{len(pictures)} pictures", "none")


@check("BehaviorStep")
def first_masks_are_valid(subject: Subject) -> None:
    """Masks are one BOOL [lanes, choices] per branch, or none; every lane has an allowed choice."""
    for view in subject.short_session.first:
        expect_masks(view)


@check("BehaviorStep")
def first_deciding_is_valid(subject: Subject) -> None:
    """Deciding is BOOL [lanes], or absent if every lane decides."""
    for view in subject.short_session.first:
        expect_deciding(view)


@check("Start")
def one_arena_can_be_started(subject: Subject) -> None:
    """A session has 1 arena or more, and each tensor has one row per lane."""
    _expect_rows(subject, 1)


@check("Start")
def max_arenas_can_be_started(subject: Subject) -> None:
    """A session may have as many as max_arenas arenas."""
    _expect_rows(subject, min(subject.spec.max_arenas, 65_536))


def _expect_rows(subject: Subject, arenas: int) -> None:
    (response,) = subject.expect_answered(subject.start(arenas))
    for step, behavior in zip(response.started.step.behaviors, subject.spec.behaviors, strict=False):
        got, expected = list(step.terminated.shape), [arenas * behavior.agents_per_arena]
        expect(got == expected, f"terminated of shape {got} of {behavior.name} with {arenas} arenas", expected)
