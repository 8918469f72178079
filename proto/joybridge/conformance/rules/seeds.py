"""Determinism: the same seed and actions give the same bytes, and another seed gives different ones."""

from joybridge.conformance.expectations import expect, skip_unless
from joybridge.conformance.recording import Recording, expect_same_recording
from joybridge.conformance.registry import check
from joybridge.conformance.step_view import arena_rows
from joybridge.conformance.subject import LARGEST_SEED, LONG_SECONDS, SEED, SHORT, Subject


@check("DETERMINISM")
def same_seed_gives_the_same_bytes(subject: Subject) -> None:
    """The same game, options, parameters, seed and actions give the same bytes."""
    expect_same_recording(subject.record(), subject.short_session, "of a second session")


@check("DETERMINISM")
def same_seed_gives_the_same_bytes_in_a_long_session(subject: Subject) -> None:
    """The same game, options, parameters, seed and actions give the same bytes, also after the end of an episode."""
    long = subject.long_session
    got = subject.record(min(len(long.steps) - 1, 300), seconds=LONG_SECONDS)
    expect(got.end is None, f"{got.end} after {len(got.steps)} responses", "a Step")
    expected = Recording(subject.spec, long.arenas, steps=long.steps[: len(got.steps)])
    expect_same_recording(got, expected, "of a second session")


@check("DETERMINISM")
def different_seeds_give_different_episodes(subject: Subject) -> None:
    """A seed is honored or refused, never ignored."""
    _expect_different_episodes(subject, [SEED, 2, 3])


@check("DETERMINISM")
def high_bits_of_a_seed_are_used(subject: Subject) -> None:
    """A seed is honored with all its 64 bits, or refused."""
    _expect_different_episodes(subject, [SEED, SEED + 2**32, SEED + 2**63])


@check("Start")
def seed_zero_is_deterministic(subject: Subject) -> None:
    """Seed 0 is honored; it does not mean a random seed."""
    expect_same_recording(_with_seed(subject, 0), _with_seed(subject, 0), "with seed 0")


@check("Start")
def largest_seed_is_deterministic(subject: Subject) -> None:
    """A seed is a uint64; the largest one is honored."""
    one, other = _with_seed(subject, LARGEST_SEED), _with_seed(subject, LARGEST_SEED)
    expect_same_recording(one, other, f"with seed {LARGEST_SEED}")


@check("DETERMINISM")
def largest_seeds_give_different_episodes(subject: Subject) -> None:
    """Seeds are integers: two seeds differ also if they round to the same floating-point number."""
    _expect_different_episodes(subject, [LARGEST_SEED, LARGEST_SEED - 1])


@check("DETERMINISM")
def arena_does_not_depend_on_the_number_of_arenas(subject: Subject) -> None:
    """The bytes of an arena do not depend on the number of arenas of the session."""
    _expect_same_rows(_rows(subject, 1, 0), _rows(subject, 4, 0), 0)


@check("Start")
def first_arena_selects_the_arena_numbers(subject: Subject) -> None:
    """Arena k of a session is arena first_arena + k of the seed."""
    _expect_same_rows(_rows(subject, 2, 2), _rows(subject, 4, 0), 2)


@check("Start")
def arena_numbers_may_exceed_32_bits(subject: Subject) -> None:
    """first_arena is a uint32, and first_arena + k may need more than 32 bits."""
    last = 2**32 - 1
    skip_unless(subject.spec.max_arenas >= 2, "max_arenas is 1")
    _expect_same_rows(_rows(subject, 1, last), _rows(subject, 2, last), 0)


def _with_seed(subject: Subject, seed: int) -> Recording:
    recording = subject.short_session if seed == SEED else subject.record(seed=seed)
    expect(recording.end is None, f"{recording.end} with seed {seed}", "a session")
    return recording


def _expect_different_episodes(subject: Subject, seeds: list[int]) -> None:
    skip_unless(subject.is_random, "all arenas of the game play the same episode")
    episodes = {tuple(_with_seed(subject, seed).step_bytes) for seed in seeds}
    expect(len(episodes) == len(seeds), f"{len(episodes)} different episodes for seeds {seeds}", f"{len(seeds)}")


def _rows(subject: Subject, arenas: int, first_arena: int) -> list[list[list[bytes]]]:
    """Return the data of each step and arena of a session."""
    skip_unless(subject.spec.max_arenas >= arenas, f"max_arenas is {subject.spec.max_arenas}")
    recording = subject.record(2 * SHORT, arenas=arenas, first_arena=first_arena)
    expect(recording.end is None, f"{recording.end} with {arenas} arenas and first_arena {first_arena}", "a session")
    return [arena_rows(step, subject.spec, arenas) for step in recording.steps]


def _expect_same_rows(small: list[list[list[bytes]]], large: list[list[list[bytes]]], offset: int) -> None:
    for index, (one, other) in enumerate(zip(small, large, strict=True)):
        for arena, row in enumerate(one):
            got = f"different bytes in step {index} of arena {arena}"
            expect(row == other[offset + arena], got, "the bytes of this arena in the larger session")
