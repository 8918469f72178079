"""The same seed and actions give the same bytes, and another seed others."""

from joybridge.conformance.reading import Part, arena_rows, expect_bounded, expect_finite, expect_sensed
from joybridge.conformance.registry import check, expect, needs
from joybridge.conformance.subject import FEW, LARGEST_SEED, SEED, Recording, Subject, expect_same, reset_request
from joybridge.v1 import bridge_pb2 as pb


@check("DETERMINISM")
def the_same_seed_and_actions_give_the_same_bytes(subject: Subject) -> None:
    """The same game, options, parameters, seed and actions give the same bytes."""
    expect_same(subject.record(), subject.brief, "in a second session")


@check("DETERMINISM")
def a_long_play_gives_the_same_bytes_again(subject: Subject) -> None:
    """The same game, options, parameters, seed and actions give the same bytes, over the ends of episodes, too."""
    some = Recording(subject.spec, subject.long.arenas, steps=subject.long.steps[:301])
    expect_same(subject.record(len(some.steps) - 1), some, "in a second session")


@check("DETERMINISM")
def different_seeds_play_differently(subject: Subject) -> None:
    """A seed is honoured or refused, never ignored."""
    _expect_different(subject, [SEED, 2, 3])


@check("DETERMINISM")
def the_high_bits_of_a_seed_count(subject: Subject) -> None:
    """A seed is honoured or refused, never ignored: not half of it either."""
    _expect_different(subject, [SEED, SEED + 2**32, SEED + 2**63])


@check("Start")
def seed_zero_is_a_seed_like_any_other(subject: Subject) -> None:
    """A seed of 0 is honoured and does not stand for any seed."""
    expect_same(_with_seed(subject, 0), _with_seed(subject, 0), "with seed 0")


@check("Start")
def the_largest_seed_is_a_seed_like_any_other(subject: Subject) -> None:
    """A seed is a uint64; its largest value is honoured."""
    expect_same(_with_seed(subject, LARGEST_SEED), _with_seed(subject, LARGEST_SEED), f"with seed {LARGEST_SEED}")


@check("DETERMINISM")
def the_largest_seeds_play_differently(subject: Subject) -> None:
    """Seeds are integers: numbers that would be one double are two seeds."""
    _expect_different(subject, [LARGEST_SEED, LARGEST_SEED - 1])


@check("DETERMINISM")
def an_arena_plays_the_same_however_many_are_beside_it(subject: Subject) -> None:
    """The same bytes, whatever the number of arenas."""
    _expect_rows(subject, _rows(subject, 1, 0), _rows(subject, 4, 0), 0)


@check("Start")
def first_arena_continues_where_another_session_stops(subject: Subject) -> None:
    """Arena k of a session plays the game of arena first_arena + k of the seed."""
    _expect_rows(subject, _rows(subject, 2, 2), _rows(subject, 4, 0), 2)


@check("Start")
def the_largest_first_arena_is_an_arena_like_any_other(subject: Subject) -> None:
    """first_arena is a uint32, and arenas after its largest value play the games of larger numbers."""
    last = 2**32 - 1
    needs(subject.spec.max_arenas >= 2, "a session has one arena at most")
    _expect_rows(subject, _rows(subject, 1, last), _rows(subject, 2, last), 0)


@check("Reset")
def a_reset_with_a_seed_plays_what_a_new_session_would(subject: Subject) -> None:
    """With a seed, what follows a Reset is what a new session with that seed would play."""
    for seed in (SEED, LARGEST_SEED):
        came = subject.record(2 * FEW + 1, resets={FEW: reset_request(seed)})
        came.steps = came.steps[FEW + 1 :]
        expect_same(came, _with_seed(subject, seed), f"after a reset with seed {seed}")


@check("Reset")
def two_resets_with_a_seed_play_the_same(subject: Subject) -> None:
    """With a seed, what follows a Reset is what a new session would play, however often it is sent."""
    came = subject.record(FEW + 6, resets={2: reset_request(SEED), 5: reset_request(SEED)})
    came.steps = came.steps[6:]
    expect_same(came, subject.brief, "after a second reset")


@check("Reset")
def a_reset_begins_like_a_session(subject: Subject) -> None:
    """Reset is answered by a Step like the one in Started: rewards are 0 and nothing has ended."""
    for request in (reset_request(), reset_request(SEED)):
        for part in _after_reset(subject, request):
            rewards = part.rewards
            expect(rewards is None or not rewards.any(), f"rewards {rewards} after a reset", "zeros")
            holds = not part.ended.any() and not part.message.HasField("ended")
            expect(holds, "ends after a reset", "none: unfinished episodes are left without an end")


@check("Reset")
def a_reset_gives_observations_like_any_step(subject: Subject) -> None:
    """Reset is answered by a Step, with an observation per sensor, finite and within its bounds."""
    for part in _after_reset(subject, reset_request()):
        expect_sensed(part.message.observations, part, part.lanes, "observations")
        expect_finite(part)
        expect_bounded(part)


@check("Reset")
def a_session_goes_on_after_a_reset(subject: Subject) -> None:
    """Reset begins a new episode in every arena, which is then played."""
    recording = subject.record(12, resets={3: reset_request(), 6: reset_request(SEED), 9: reset_request()})
    expect(recording.end is None, f"{recording.end} after {len(recording.steps)} answers", "a step")


@check("Reset")
def a_reset_without_a_seed_begins_other_episodes(subject: Subject) -> None:
    """Without a seed, the arenas' random streams go on."""
    needs(subject.is_random, "all arenas of the game play the same")
    recording = subject.record(FEW + 1, resets={0: reset_request()})
    came, wanted = recording.records[1:], subject.brief.records
    expect(came != wanted, "the same bytes as at the start of the session", "other episodes")


@check("Reset")
def a_reset_without_a_seed_is_deterministic(subject: Subject) -> None:
    """The random streams of arenas go on as they do in any session that did the same."""
    one, other = (subject.record(FEW, resets={3: reset_request()}) for _ in range(2))
    expect_same(one, other, "after a reset without a seed")


def _after_reset(subject: Subject, request: pb.PlayRequest) -> list[Part]:
    """Return the parts of the step with which a reset is answered in the middle of a play."""
    recording = subject.record(3, resets={2: request})
    expect(len(recording.steps) > 3, f"{recording.end} after {len(recording.steps)} answers", "a step after a reset")
    return recording.parts(3)


def _with_seed(subject: Subject, seed: int) -> Recording:
    recording = subject.brief if seed == SEED else subject.record(seed=seed)
    expect(recording.end is None, f"{recording.end} with seed {seed}", "a session")
    return recording


def _expect_different(subject: Subject, seeds: list[int]) -> None:
    needs(subject.is_random, "all arenas of the game play the same")
    plays = {tuple(_with_seed(subject, seed).records) for seed in seeds}
    expect(len(plays) == len(seeds), f"{len(plays)} plays from the seeds {seeds}", "another play from each")


def _rows(subject: Subject, arenas: int, first_arena: int) -> list[list[list[object]]]:
    needs(subject.spec.max_arenas >= arenas, f"a session has {subject.spec.max_arenas} arenas at most")
    recording = subject.record(2 * FEW, arenas=arenas, first_arena=first_arena)
    expect(recording.end is None, f"{recording.end} with {arenas} arenas from {first_arena}", "a session")
    return [arena_rows(step, subject.spec, arenas) for step in recording.steps]


def _expect_rows(subject: Subject, few: list[list[list[object]]], many: list[list[list[object]]], first: int) -> None:
    for index, (one, other) in enumerate(zip(few, many, strict=True)):
        for arena, row in enumerate(one):
            holds = len(row) == len(other[first + arena]) and row == other[first + arena]
            expect(holds, f"other bytes in step {index} of arena {arena}", "those of the larger session")
