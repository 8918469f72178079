"""Snapshots: enough to continue to the same bytes, and refused where they do not fit."""

from collections.abc import Iterator
from contextlib import contextmanager
from copy import deepcopy
from typing import Any

from joybridge.conformance.registry import Broken, check, expect, needs
from joybridge.conformance.subject import (
    ARENAS,
    EARLY,
    FEW,
    INVALID,
    SAVE,
    SEED,
    Player,
    Recording,
    Subject,
    expect_same_bytes,
    reset_request,
)
from joybridge.conformance.wire import Stream
from joybridge.v1 import bridge_pb2 as pb


@check("Snapshot")
def a_session_continues_from_a_snapshot_to_the_same_bytes(subject: Subject) -> None:
    """A snapshot is enough to continue a session to the same bytes."""
    with _saved(subject) as saved:
        _expect_continued(subject, saved)


@check("Snapshot")
def a_snapshot_holds_what_a_reset_has_set(subject: Subject) -> None:
    """The seed and the parameters that a Reset has set are part of a snapshot."""
    ends = {p.name: p.low if p.default_value != p.low else p.high for p in subject.spec.parameters}
    others = {p.name: (p.default_value + ends[p.name]) / 2 for p in subject.spec.parameters}
    with _saved(subject, reset=reset_request(SEED + 1, others)) as saved:
        _expect_continued(subject, saved)


@check("Started")
def a_snapshot_brings_back_the_observations(subject: Subject) -> None:
    """After a snapshot, Started has the observations as they stood when it was taken, masks and deciding lanes, too."""
    with _saved(subject) as saved:
        pass
    (response,) = subject.answered(subject.start(snapshot=saved.recording.snapshot))
    for came, wanted in zip(response.started.step.behaviors, saved.recording.steps[-1].behaviors, strict=False):
        for field in ("observations", "masks", "deciding"):
            expect(getattr(came, field) == getattr(wanted, field), f"other {field}", "those of the saved session")


@check("Started")
def the_first_step_after_a_snapshot_pays_and_ends_nothing(subject: Subject) -> None:
    """The first step of a session has zero rewards and no ends."""
    with _saved(subject) as saved:
        pass
    (response,) = subject.answered(subject.start(snapshot=saved.recording.snapshot))
    for part in response.started.step.behaviors:
        quiet = not any(part.rewards.data + part.terminated.data + part.truncated.data) and not part.HasField("ended")
        expect(quiet, "rewards or ends", "none")


@check("Save")
def saving_changes_nothing_of_the_play(subject: Subject) -> None:
    """Save asks for a snapshot and for nothing else."""
    with _saved(subject, 3) as player:
        for _ in range(FEW - 3):
            player.decide()
    expect_same_bytes(player.recording.records, subject.brief.records, "after a save")


@check("Snapshot")
def two_saves_give_the_same_snapshot(subject: Subject) -> None:
    """A snapshot is the state of all arenas of a session."""
    with _saved(subject) as player:
        first = player.recording.snapshot
        player.save()
    expect(player.recording.snapshot == first, "another snapshot", "the same one where nothing was played")


@check("GameSpec")
def a_snapshot_is_no_larger_than_the_spec_says(subject: Subject) -> None:
    """snapshot_bytes_per_arena is the most a Snapshot takes, per arena."""
    came = sum(map(len, _snapshot(subject).parts.values()))
    most = ARENAS * subject.spec.snapshot_bytes_per_arena
    expect(came <= most, f"{came} bytes for {ARENAS} arenas", f"at most {most}")


@check("Start")
def a_snapshot_of_another_seed_is_refused(subject: Subject) -> None:
    """Everything else in Start must be as it was in the session that was saved."""
    _refuse(subject, _snapshot(subject), seed=SEED + 1)


@check("Start")
def a_snapshot_of_another_first_arena_is_refused(subject: Subject) -> None:
    """Everything else in Start must be as it was in the session that was saved."""
    _refuse(subject, _snapshot(subject), first_arena=1)


@check("Start")
def a_snapshot_of_more_or_fewer_arenas_is_refused(subject: Subject) -> None:
    """Everything else in Start must be as it was in the session that was saved."""
    snapshot = _snapshot(subject)
    for arenas in (1, 3):
        if arenas <= subject.spec.max_arenas:
            _refuse(subject, snapshot, arenas=arenas)


@check("Start")
def a_snapshot_of_another_choice_is_refused(subject: Subject) -> None:
    """Everything else in Start must be as it was in the session that was saved."""
    snapshot = _snapshot(subject)
    needs(subject.spec.options, "the game has no options")
    for option in subject.spec.options:
        for choice in [c for c in option.choices if c != option.default_choice][:1]:
            _refuse(subject, snapshot, options={option.name: choice})


@check("Start")
def a_snapshot_of_other_parameters_is_refused(subject: Subject) -> None:
    """Everything else in Start must be as it was in the session that was saved."""
    snapshot = _snapshot(subject)
    needs(subject.spec.parameters, "the game has no parameters")
    for p in subject.spec.parameters:
        _refuse(subject, snapshot, parameters={p.name: p.low if p.default_value != p.low else p.high})


@check("Start")
def an_empty_snapshot_is_refused(subject: Subject) -> None:
    """A snapshot is refused with INVALID_ARGUMENT where it does not fit."""
    _needs_snapshots(subject)
    _refuse(subject, pb.Snapshot())


@check("Start")
def a_snapshot_of_strange_parts_is_refused(subject: Subject) -> None:
    """A snapshot is refused with INVALID_ARGUMENT where it does not fit."""
    _needs_snapshots(subject)
    _refuse(subject, pb.Snapshot(parts={"no_such_part": b"garbage"}))


@check("Start")
def a_snapshot_without_one_of_its_parts_is_refused(subject: Subject) -> None:
    """A snapshot is the state of all arenas, and refused with INVALID_ARGUMENT where it does not fit."""
    whole = _snapshot(subject)
    for name in whole.parts:
        _refuse(subject, pb.Snapshot(parts={other: data for other, data in whole.parts.items() if other != name}))


@check("Start")
def a_snapshot_that_was_cut_short_is_refused(subject: Subject) -> None:
    """A snapshot is the state of all arenas, and refused with INVALID_ARGUMENT where it does not fit."""
    whole = _snapshot(subject)
    for name, data in whole.parts.items():
        if data:
            _refuse(subject, pb.Snapshot(parts={**whole.parts, name: data[:-1]}))


@check("GameSpec")
def a_game_without_snapshots_refuses_to_save(subject: Subject) -> None:
    """Save is FAILED_PRECONDITION where the spec says snapshot_bytes_per_arena = 0."""
    needs(not subject.spec.snapshot_bytes_per_arena, "the game has snapshots")
    subject.refused(subject.start(), SAVE, codes=[EARLY], words=["snapshot"])


@check("Start")
def a_game_without_snapshots_refuses_to_start_from_one(subject: Subject) -> None:
    """A snapshot is refused where it does not fit."""
    needs(not subject.spec.snapshot_bytes_per_arena, "the game has snapshots")
    # Start says INVALID_ARGUMENT and Save FAILED_PRECONDITION; a server may see it either way.
    snapshot = pb.Snapshot(parts={"part": b"garbage"})
    subject.refused(subject.start(snapshot=snapshot), codes=[INVALID, EARLY], words=["snapshot"])


def _needs_snapshots(subject: Subject) -> None:
    needs(subject.spec.snapshot_bytes_per_arena, "the game has no snapshots")


@contextmanager
def _saved(subject: Subject, decisions: int = FEW, reset: pb.PlayRequest | None = None) -> Iterator[Player]:
    """Yield a player who has played for a while, since a reset if there is one, and saved."""
    _needs_snapshots(subject)
    with Stream(subject.server) as stream:
        player = Player(stream, Recording(subject.spec, ARENAS), subject.start())
        if reset:
            player.begin(reset)
        for _ in range(decisions):
            player.decide()
        if player.recording.end:
            raise Broken(f"{player.recording.end} in a play before a save", "a play")
        player.save()
        yield player


def _expect_continued(subject: Subject, saved: Player) -> None:
    """Raise Broken unless a session from the snapshot goes on as the one that was saved."""
    randoms, before = deepcopy(saved.randoms), len(saved.recording.steps)
    for _ in range(2 * FEW):
        saved.decide()
    with Stream(subject.server) as stream:
        start = subject.start(snapshot=saved.recording.snapshot)
        player = Player(stream, Recording(subject.spec, ARENAS), start)
        player.randoms = randoms
        for _ in range(2 * FEW):
            player.decide()
    came = player.recording
    expect(came.end is None, f"{came.end} after {len(came.steps)} answers", "a session that goes on")
    expect_same_bytes(came.records[1:], saved.recording.records[before:], "after the snapshot")


def _snapshot(subject: Subject) -> pb.Snapshot:
    """Return the snapshot of a session that has been played for a while."""
    with _saved(subject) as player:
        assert player.recording.snapshot is not None
        return player.recording.snapshot


def _refuse(subject: Subject, snapshot: pb.Snapshot, **fields: Any) -> None:
    subject.refused(subject.start(snapshot=snapshot, **fields), words=["snapshot"])
