"""Determinism: the same seed and actions give the same bytes, and another seed gives different ones."""

from collections.abc import Sequence

from joybridge.conformance.expectations import expect, skip_unless
from joybridge.conformance.recording import Recording, expect_same_bytes, expect_same_recording
from joybridge.conformance.registry import check, table
from joybridge.conformance.step_view import arena_rows
from joybridge.conformance.subject import CROWD, MAX_SEED, SEED, SHORT, Subject

MAX_ARENA = 2**32 - 1  # of first_arena


@check("DETERMINISM")
def same_seed_gives_the_same_bytes(subject: Subject) -> None:
    """The same game, options, parameters, seed and actions give the same bytes."""
    expect_same_recording(subject.record(), subject.short_session, "of a second session")


@check("DETERMINISM")
def same_seed_gives_the_same_bytes_in_a_long_session(subject: Subject) -> None:
    """The same game, options, parameters, seed and actions give the same bytes, also after the end of an episode."""
    long = subject.long_session
    got = subject.record_long(min(len(long.steps) - 1, 300))
    expect(got.end is None, f"{got.end} after {len(got.steps)} responses", "a Step")
    # The clock ends both sessions, so the second one may be shorter or longer.
    steps = min(len(got.steps), len(long.steps))
    expect_same_bytes(got.step_bytes[:steps], long.step_bytes[:steps], "of a second session")


DIFFERENT = (  # name, section, rule, seeds
    (
        "different_seeds_give_different_episodes",
        "DETERMINISM",
        "A seed is honored or refused, never ignored.",
        [SEED, 2, 3],
    ),
    (
        "high_bits_of_a_seed_are_used",
        "DETERMINISM",
        "A seed is honored with all its 64 bits, or refused.",
        [SEED, SEED + 2**32, SEED + 2**63],
    ),
    (
        "largest_seeds_give_different_episodes",
        "DETERMINISM",
        "Seeds are integers: two seeds differ also if they round to the same floating-point number.",
        [MAX_SEED, MAX_SEED - 1],
    ),
)
SAME = (  # name, section, rule, seed
    ("seed_zero_is_deterministic", "Start", "Seed 0 is honored; it does not mean a random seed.", 0),
    ("largest_seed_is_deterministic", "Start", "A seed is a uint64; the largest one is honored.", MAX_SEED),
)
ARENAS = (  # name, section, rule, arenas of a session and the first of them, those of a larger one, the offset in it
    ("arena_does_not_depend_on_the_number_of_arenas", "DETERMINISM",
     "The bytes of an arena do not depend on the number of arenas of the session.", (1, 0), (4, 0), 0),
    ("first_arena_selects_the_arena_numbers", "Start",
     "Arena k of a session is arena first_arena + k of the seed.", (2, 2), (4, 0), 2),
    ("arena_numbers_may_exceed_32_bits", "Start",
     "first_arena is a uint32, and first_arena + k may need more than 32 bits.", (1, MAX_ARENA), (2, MAX_ARENA), 0),
)  # fmt: skip


@table(DIFFERENT)
def _give_different_episodes(subject: Subject, seeds: list[int]) -> None:
    skip_unless(subject.is_random, "all arenas of the game play the same episode")
    arenas = min(CROWD, subject.spec.max_arenas)
    episodes = {tuple(_with_seed(subject, seed, arenas).step_bytes) for seed in seeds}
    expect(len(episodes) == len(seeds), f"{len(episodes)} different episodes for seeds {seeds}", f"{len(seeds)}")


@table(SAME)
def _is_deterministic(subject: Subject, seed: int) -> None:
    expect_same_recording(_with_seed(subject, seed), _with_seed(subject, seed), f"with seed {seed}")


@table(ARENAS)
def _arenas_are_those_of_a_larger_session(
    subject: Subject, part: tuple[int, int], whole: tuple[int, int], offset: int
) -> None:
    skip_unless(subject.spec.max_arenas >= whole[0], f"max_arenas is {subject.spec.max_arenas}")
    for index, (one, other) in enumerate(zip(_rows(subject, *part), _rows(subject, *whole), strict=True)):
        for arena, row in enumerate(one):
            got = f"different bytes in step {index} of arena {arena}"
            expect(row == other[offset + arena], got, "the bytes of this arena in the larger session")


@check("Start")
def seed_and_arena_are_two_numbers(subject: Subject) -> None:
    """Each arena of each seed has a random stream of its own: arena 1 of seed 0 is not arena 0 of seed 1."""
    _require_crowd(subject)
    zero, one = (_crowd(subject, seed=seed) for seed in (0, 1))
    for name, same in (("seed + arena", zero[1:] == one[:-1]), ("seed xor arena", _swapped(zero) == one)):
        expect(not same, f"{CROWD} arenas of seeds 0 and 1 that depend on {name} only", "other episodes for each pair")


@check("Start")
def arena_numbers_do_not_wrap_around(subject: Subject) -> None:
    """The number first_arena + k may need more than 32 bits: arena 2^32 is not arena 0."""
    _require_crowd(subject)
    beyond = _crowd(subject, first_arena=MAX_ARENA)[1:]
    got = "the episodes of arenas 0, 1, … in the arenas from 2^32 on"
    expect(beyond != _crowd(subject)[:-1], got, "episodes of their own")


def _with_seed(subject: Subject, seed: int, arenas: int | None = None) -> Recording:
    recording = subject.record(arenas=arenas, seed=seed)
    expect(recording.end is None, f"{recording.end} with seed {seed}", "a session")
    return recording


def _require_crowd(subject: Subject) -> None:
    skip_unless(subject.is_random, "all arenas of the game play the same episode")
    skip_unless(subject.spec.max_arenas >= CROWD, f"max_arenas is {subject.spec.max_arenas}")


def _crowd(subject: Subject, **fields: int) -> list[list[list[bytes]]]:
    """Return the data of CROWD arenas in each step. Their actions are the same, so they differ by chance alone."""
    recording = subject.record(arenas=CROWD, numbers=[0] * CROWD, **fields)  # type: ignore[arg-type]
    expect(recording.end is None, f"{recording.end} with {fields}", "a session")
    steps = [arena_rows(step, subject.spec, CROWD) for step in recording.steps]
    return [[rows[arena] for rows in steps] for arena in range(CROWD)]


def _swapped(arenas: Sequence[list[list[bytes]]]) -> list[list[list[bytes]]]:
    """Return the data of the arenas with every two neighbors exchanged."""
    return [arenas[number ^ 1] for number in range(len(arenas))]


def _rows(subject: Subject, arenas: int, first_arena: int) -> list[list[list[bytes]]]:
    """Return the data of each step and arena of a session."""
    recording = subject.record(2 * SHORT, arenas=arenas, first_arena=first_arena)
    expect(recording.end is None, f"{recording.end} with {arenas} arenas and first_arena {first_arena}", "a session")
    return [arena_rows(step, subject.spec, arenas) for step in recording.steps]
