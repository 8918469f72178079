"""The first step of a session, before anything was done."""

from joybridge.conformance.reading import expect_bounded, expect_finite, expect_fit, expect_sensed
from joybridge.conformance.registry import check, expect, expect_equal, needs
from joybridge.conformance.rules.steps import expect_deciding, expect_masks
from joybridge.conformance.subject import Subject, act_request
from joybridge.conformance.wire import OK
from joybridge.v1 import bridge_pb2 as pb


@check("Started")
def a_session_can_be_started(subject: Subject) -> None:
    """Start is answered by Started, with a spec and a first step."""
    (response,) = subject.answered(subject.start())
    expect_equal(response.WhichOneof("response"), "started", "the response")
    expect(response.started.HasField("spec") and response.started.HasField("step"), "half of it", "a spec and a step")


@check("Started")
def a_session_starts_with_the_spec_that_was_described(subject: Subject) -> None:
    """The spec in Started is as DescribeGame gives it for these options."""
    started = subject.brief.started
    expect(started is not None and started.spec == subject.spec, "another spec", "the one of DescribeGame")


@check("Started")
def a_choice_starts_with_the_spec_that_was_described_for_it(subject: Subject) -> None:
    """The spec in Started is as DescribeGame gives it for these options, and a session plays under every choice."""
    needs(subject.spec.options, "the game has no options")
    for option in subject.spec.options:
        for choice in option.choices:
            chosen = {option.name: choice}
            (response,) = subject.answered(subject.start(options=chosen))
            same = response.started.spec == subject.server.describe(subject.game, chosen)
            expect(same, f"another spec for {chosen}", "the one of DescribeGame")


@check("Step")
def the_first_step_has_every_behavior(subject: Subject) -> None:
    """A step has one BehaviorStep per behavior of the spec."""
    came, wanted = len(subject.brief.steps[0].behaviors) if subject.brief.steps else 0, len(subject.spec.behaviors)
    expect(came == wanted, f"{came} behaviors", wanted)


@check("BehaviorStep")
def first_observations_have_the_shape_of_their_sensors(subject: Subject) -> None:
    """Observations are one tensor per sensor, [lanes, *shape]."""
    for part in subject.brief.first:
        expect_sensed(part.message.observations, part, part.lanes, "observations")


@check("Tensor")
def first_observations_are_finite(subject: Subject) -> None:
    """FLOAT32 values must be finite."""
    for part in subject.brief.first:
        expect_finite(part)


@check("Sensor")
def first_observations_lie_within_their_bounds(subject: Subject) -> None:
    """Low is the smallest value of a sensor and high the largest."""
    for part in subject.brief.first:
        expect_bounded(part)


@check("Started")
def the_first_rewards_are_zero(subject: Subject) -> None:
    """In the first step of a session rewards are 0."""
    for part in subject.brief.first:
        expect_fit(part.message.rewards, pb.DTYPE_FLOAT32, (part.lanes, len(part.behavior.channels)), "rewards")
        rewards = part.rewards
        expect(rewards is not None and not rewards.any(), f"rewards {rewards} of {part.where}", "zeros")


@check("Started")
def nothing_has_ended_in_the_first_step(subject: Subject) -> None:
    """In the first step of a session nothing has ended."""
    for part in subject.brief.first:
        for flags, what in ((part.message.terminated, "terminated"), (part.message.truncated, "truncated")):
            expect_fit(flags, pb.DTYPE_BOOL, (part.lanes,), what)
            expect(not any(flags.data), f"{what} {list(flags.data)} of {part.where}", "no ends")
        expect(not part.message.HasField("ended"), f"ended of {part.where}", "none: no episode ended")


@check("Step")
def the_first_step_has_no_pictures(subject: Subject) -> None:
    """There is one picture per arena in Act.draw, and nothing has been drawn yet."""
    for step in subject.brief.steps[:1]:
        expect(not step.pictures, f"{len(step.pictures)} pictures", "none")


@check("BehaviorStep")
def first_masks_are_well_formed(subject: Subject) -> None:
    """Masks are BOOL [lanes, choices] per branch, or none; a lane always has something to choose."""
    for part in subject.brief.first:
        expect_masks(part)


@check("BehaviorStep")
def first_deciding_is_well_formed(subject: Subject) -> None:
    """Deciding is BOOL [lanes], or absent."""
    for part in subject.brief.first:
        expect_deciding(part)


@check("Start")
def one_arena_is_enough(subject: Subject) -> None:
    """A session has 1 or more arenas, and as many rows as lanes."""
    _expect_rows(subject, 1)


@check("Start")
def as_many_arenas_as_the_spec_allows_can_be_started(subject: Subject) -> None:
    """A session may ask for max_arenas arenas."""
    _expect_rows(subject, min(subject.spec.max_arenas, 65_536))


@check("SESSION")
def a_client_that_has_finished_ends_its_session_without_an_error(subject: Subject) -> None:
    """The stream is the session: closing it frees the arenas, and is no error."""
    played = subject.play(*subject.brief.requests[:3])
    expect(played.end == OK, played.end, "OK")


@check("SESSION")
def requests_are_answered_one_by_one_and_in_order(subject: Subject) -> None:
    """The client sends one request and gets one response, in order: Started for Start, Step for Act and Reset."""
    act = subject.brief.requests[1] if len(subject.brief.requests) > 1 else act_request(pb.Act())
    reset = pb.PlayRequest(reset=pb.Reset(seed=1))
    came = [r.WhichOneof("response") for r in subject.answered(subject.start(), act, reset, reset)]
    expect_equal(came, ["started", "step", "step", "step"], "responses")


def _expect_rows(subject: Subject, arenas: int) -> None:
    (response,) = subject.answered(subject.start(arenas))
    for part, kind in zip(response.started.step.behaviors, subject.spec.behaviors, strict=False):
        came, wanted = list(part.terminated.shape), [arenas * kind.agents_per_arena]
        expect(came == wanted, f"{came} lanes of {kind.name} in {arenas} arenas", wanted)
