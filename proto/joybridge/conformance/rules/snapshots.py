"""Snapshots: a session continues from one with the same bytes, and invalid snapshots are refused."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from copy import deepcopy
from typing import Any

from joybridge.conformance.client import Stream
from joybridge.conformance.expectations import Violation, expect, skip_unless
from joybridge.conformance.recording import SAVE, Player, expect_same_bytes, reset_request
from joybridge.conformance.registry import Rows, check, table
from joybridge.conformance.spec_expectations import parts_of
from joybridge.conformance.step_expectations import expect_finite, expect_in_bounds
from joybridge.conformance.subject import FAILED_PRECONDITION, INVALID_ARGUMENT, SEED, SHORT, Subject
from joybridge.v1 import bridge_pb2 as pb


@check("Snapshot")
def session_continues_from_a_snapshot(subject: Subject) -> None:
    """A session that continues from a snapshot gives the same bytes as the one that was saved."""
    with _saved(subject) as saved:
        _expect_continued(subject, saved)


@check("Snapshot")
def snapshot_includes_seed_and_parameters_of_reset(subject: Subject) -> None:
    """A snapshot includes the seed and the parameters of the last Reset."""
    ends = subject.other_parameters()
    others = {p.name: (p.default_value + ends[p.name]) / 2 for p in subject.spec.parameters}
    with _saved(subject, reset=reset_request(SEED + 1, others)) as saved:
        _expect_continued(subject, saved)


@check("Started")
def started_from_a_snapshot_has_the_saved_observations(subject: Subject) -> None:
    """After a snapshot, Started has the observations, masks and deciding lanes of the saved session."""
    for got, expected in _first_steps(subject):
        for field in ("observations", "masks", "deciding"):
            same = getattr(got, field) == getattr(expected, field)
            expect(same, f"different {field}", "those of the saved session")


@check("Started")
def started_from_a_snapshot_has_no_rewards_and_no_ends(subject: Subject) -> None:
    """In the first step of a session rewards are 0 and no episode has ended, also after a snapshot."""
    for got, _ in _first_steps(subject):
        none = not any(got.rewards.data + got.terminated.data + got.truncated.data) and not got.HasField("ended")
        expect(none, "rewards or ends", "none")


@check("Save")
def saving_does_not_change_the_session(subject: Subject) -> None:
    """Save requests a snapshot and has no other effect."""
    with _saved(subject, 3) as player:
        for _ in range(SHORT - 3):
            player.decide()
    expect_same_bytes(player.recording.step_bytes, subject.short_session.step_bytes, "after a Save")


@check("Snapshot")
def second_save_gives_the_same_snapshot(subject: Subject) -> None:
    """A snapshot is the state of all arenas, so that two without an Act between them are equal."""
    with _saved(subject) as player:
        first = player.recording.snapshot
        player.save()
    expect(player.recording.snapshot == first, "a different snapshot", "the same one")


@check("GameSpec")
def snapshot_is_not_larger_than_the_spec_says(subject: Subject) -> None:
    """A snapshot has at most snapshot_bytes_per_arena bytes per arena."""
    got = sum(map(len, _snapshot(subject).parts.values()))
    most = subject.arenas * subject.spec.snapshot_bytes_per_arena
    expect(got <= most, f"{got} bytes for {subject.arenas} arenas", f"at most {most}")


OTHER = "All other fields of Start must be those of the session that was saved."
PARTIAL = "A snapshot is the state of all arenas; one that does not fit is INVALID_ARGUMENT."
FIELDS = (  # name, section, rule, the fields of Start that the session was not saved with: each is refused alone
    ("snapshot_with_another_seed_is_refused", "Start", OTHER, lambda subject: [{"seed": SEED + 1}]),
    ("snapshot_with_another_first_arena_is_refused", "Start", OTHER, lambda subject: [{"first_arena": 1}]),
    ("snapshot_with_another_number_of_arenas_is_refused", "Start", OTHER,
     lambda subject: [{"arenas": n} for n in (1, 3) if subject.arenas != n <= subject.spec.max_arenas]),
    ("snapshot_with_another_choice_is_refused", "Start", OTHER,
     lambda subject: [{"options": {option.name: choice}} for option in parts_of(subject.spec, "options")
                      for choice in [c for c in option.choices if c != option.default_choice][:1]]),
    ("snapshot_with_other_parameters_is_refused", "Start", OTHER,
     lambda subject: [{"parameters": {p.name: subject.other_parameters()[p.name]}}
                      for p in parts_of(subject.spec, "parameters") if p.low < p.high]),
)  # fmt: skip
PARTS: Rows = (  # name, section, rule, the parts that are refused instead of those that were saved
    ("empty_snapshot_is_refused", "Start", "A snapshot that does not fit is INVALID_ARGUMENT.", lambda whole: [{}]),
    (
        "snapshot_with_unknown_parts_is_refused",
        "Start",
        "A snapshot that does not fit is INVALID_ARGUMENT.",
        lambda whole: [{"no_such_part": b"garbage"}],
    ),
    (
        "snapshot_with_a_missing_part_is_refused",
        "Start",
        PARTIAL,
        lambda whole: [{other: whole[other] for other in whole if other != name} for name in whole],
    ),
    (
        "snapshot_with_a_missing_byte_is_refused",
        "Start",
        PARTIAL,
        lambda whole: [{**whole, name: data[:-1]} for name, data in whole.items() if data],
    ),
)


@table(FIELDS)
def _fields_are_refused(subject: Subject, fields: Callable[[Subject], list[dict[str, Any]]]) -> None:
    snapshot = _snapshot(subject)
    for other in fields(subject):
        subject.expect_refused(subject.start(snapshot=snapshot, **other), words=["snapshot"])


@table(PARTS)
def _parts_are_refused(subject: Subject, parts: Callable[[dict[str, bytes]], list[dict[str, bytes]]]) -> None:
    for other in parts(dict(_snapshot(subject).parts)):
        subject.expect_refused(subject.start(snapshot=pb.Snapshot(parts=other)), words=["snapshot"])


@check("Snapshot")
def values_of_a_snapshot_are_checked(subject: Subject) -> None:
    """The server checks the values of a snapshot: those that cannot occur are refused, or do no harm."""
    whole = _snapshot(subject)
    for name, data in whole.parts.items():
        changed = pb.Snapshot(parts={**whole.parts, name: b"\xff" * len(data)})  # as floats these are NaN
        recording = subject.record(snapshot=changed)
        where = f"part {name!r} full of the byte 0xFF"
        if not recording.steps:
            got = f"{recording.end} for {where}"
            expect(recording.end and recording.end.code == INVALID_ARGUMENT, got, "INVALID_ARGUMENT")
            continue
        expect(recording.end is None, f"{recording.end} after a Start with {where}", "INVALID_ARGUMENT at the Start")
        for view in [*recording.first, *recording.later]:
            try:
                expect_finite(view)
                expect_in_bounds(view)
            except Violation as violation:
                raise Violation(f"{violation.got}, from {where}", "INVALID_ARGUMENT at the Start") from violation


@check("GameSpec")
def save_is_refused_without_snapshots(subject: Subject) -> None:
    """If the spec says snapshot_bytes_per_arena = 0, Save is FAILED_PRECONDITION."""
    skip_unless(not subject.spec.snapshot_bytes_per_arena, "the game has snapshots")
    subject.expect_refused(subject.start(), SAVE, codes=[FAILED_PRECONDITION], words=["snapshot"])


@check("Start")
def start_from_a_snapshot_is_refused_without_snapshots(subject: Subject) -> None:
    """A snapshot is refused if the game has no snapshots."""
    skip_unless(not subject.spec.snapshot_bytes_per_arena, "the game has snapshots")
    # Start names FAILED_PRECONDITION; INVALID_ARGUMENT is accepted too.
    start = subject.start(snapshot=pb.Snapshot(parts={"part": b"garbage"}))
    subject.expect_refused(start, codes=[INVALID_ARGUMENT, FAILED_PRECONDITION], words=["snapshot"])


def _require_snapshots(subject: Subject) -> None:
    skip_unless(subject.spec.snapshot_bytes_per_arena, "the game has no snapshots")


@contextmanager
def _saved(subject: Subject, decisions: int = SHORT, reset: pb.PlayRequest | None = None) -> Iterator[Player]:
    """Yield a player that started, sent `reset` if there is one, played some decisions and saved."""
    _require_snapshots(subject)
    with Stream(subject.client) as stream:
        player = subject.player(stream)
        if reset:
            player.begin(reset)
        for _ in range(decisions):
            player.decide()
        if player.recording.end:
            raise Violation(f"{player.recording.end} before the Save", "a session")
        player.save()
        yield player


def _first_steps(subject: Subject) -> Iterator[tuple[pb.BehaviorStep, pb.BehaviorStep]]:
    """Yield each behavior of the first step from a snapshot, and of the step before the Save."""
    with _saved(subject) as saved:
        pass
    (response,) = subject.expect_answered(subject.start(snapshot=saved.recording.snapshot))
    yield from zip(response.started.step.behaviors, saved.recording.steps[-1].behaviors, strict=False)


def _expect_continued(subject: Subject, saved: Player) -> None:
    """Raise Violation unless a session from the snapshot continues like the one that was saved."""
    generators, before = deepcopy(saved.generators), len(saved.recording.steps)
    for _ in range(2 * SHORT):
        saved.decide()
    with Stream(subject.client) as stream:
        player = subject.player(stream, snapshot=saved.recording.snapshot)
        player.generators = generators
        for _ in range(2 * SHORT):
            player.decide()
    got = player.recording
    expect(got.end is None, f"{got.end} after {len(got.steps)} responses", "a session from the snapshot")
    expect_same_bytes(got.step_bytes[1:], saved.recording.step_bytes[before:], "after the snapshot")


def _snapshot(subject: Subject) -> pb.Snapshot:
    """Return the snapshot of a short session."""
    with _saved(subject) as player:
        assert player.recording.snapshot is not None
        return player.recording.snapshot
