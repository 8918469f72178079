"""Reset: it begins new episodes, with a seed as in a new session."""

from joybridge.conformance.expectations import expect, skip_unless
from joybridge.conformance.recording import expect_same_recording, reset_request
from joybridge.conformance.registry import check
from joybridge.conformance.step_expectations import (
    expect_finite,
    expect_in_bounds,
    expect_no_ends,
    expect_no_rewards,
    expect_observations,
)
from joybridge.conformance.step_view import StepView
from joybridge.conformance.subject import CROWD, MAX_SEED, SEED, SHORT, Subject
from joybridge.v1 import bridge_pb2 as pb


@check("Reset")
def reset_with_seed_acts_as_a_new_session(subject: Subject) -> None:
    """With a seed, the steps after a Reset are those of a new session with that seed."""
    for seed in (SEED, MAX_SEED):
        expected = subject.short_session if seed == SEED else subject.record(seed=seed)
        expect(expected.end is None, f"{expected.end} with seed {seed}", "a session")
        got = subject.record_reset(reset_request(seed))
        expect_same_recording(got, expected, f"after a Reset with seed {seed}")


@check("Reset")
def second_reset_with_seed_acts_as_a_new_session(subject: Subject) -> None:
    """With a seed, the steps after a Reset are those of a new session, also after a second Reset."""
    got = subject.record(SHORT + 6, resets={2: reset_request(SEED), 5: reset_request(SEED)})
    got.steps = got.steps[6:]
    expect_same_recording(got, subject.short_session, "after a second Reset")


@check("Reset")
def step_after_reset_has_no_rewards_and_no_ends(subject: Subject) -> None:
    """The step after a Reset is like the one in Started: rewards are 0 and no episode has ended."""
    for request in (reset_request(), reset_request(SEED)):
        for view in _after_reset(subject, request):
            expect_no_rewards(view)
            expect_no_ends(view)


@check("Reset")
def observations_after_reset_are_valid(subject: Subject) -> None:
    """The step after a Reset has one observation per sensor, finite and in bounds."""
    for view in _after_reset(subject, reset_request()):
        expect_observations(view)
        expect_finite(view)
        expect_in_bounds(view)


@check("Reset")
def session_continues_after_reset(subject: Subject) -> None:
    """A Reset begins a new episode in every arena, and the session goes on."""
    recording = subject.record(12, resets={3: reset_request(), 6: reset_request(SEED), 9: reset_request()})
    expect(recording.end is None, f"{recording.end} after {len(recording.steps)} responses", "a Step")


@check("Reset")
def reset_without_seed_begins_different_episodes(subject: Subject) -> None:
    """Without a seed, the random streams of the arenas continue."""
    skip_unless(subject.is_random, "all arenas of the game play the same episode")
    arenas = min(CROWD, subject.spec.max_arenas)
    recording = subject.record(SHORT + 1, arenas, resets={0: reset_request()})
    same = recording.step_bytes[1:] == subject.record(SHORT, arenas).step_bytes
    expect(not same, "the same bytes as from the start of the session", "different episodes")


@check("Reset")
def reset_without_seed_is_deterministic(subject: Subject) -> None:
    """The random streams continue in the same way in every session with the same requests."""
    one, other = (subject.record(SHORT, resets={3: reset_request()}) for _ in range(2))
    expect_same_recording(one, other, "after a Reset without a seed")


def _after_reset(subject: Subject, request: pb.PlayRequest) -> list[StepView]:
    """Return the views of the step after a Reset in the middle of a session."""
    recording = subject.record(3, resets={2: request})
    got = f"{recording.end} after {len(recording.steps)} responses"
    expect(len(recording.steps) > 3, got, "a Step in response to Reset")
    return recording.views(3)
