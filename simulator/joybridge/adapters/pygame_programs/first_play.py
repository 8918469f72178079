"""What is found out about a program by playing it for some seconds before it is served."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import pairwise
from statistics import median
from typing import Any, NamedTuple

import numpy as np

from joybridge.adapters.pygame_programs.form import Form, Look, make_form, make_look, options_of
from joybridge.adapters.pygame_programs.players import Played, Players
from joybridge.adapters.pygame_programs.processes import ProgramProcesses
from joybridge.adapters.pygame_programs.wire import ENDING
from joybridge.contract.spec import choose_options

QUIET_FRAMES = 32  # that are played without input to measure their length, if nothing else is played
WATCHED_FRAMES = 160  # in which one key after the other is pressed
SAME_FRAMES = (20, 40)  # before and after a snapshot, with random acts


class FirstPlay(NamedTuple):
    """What was found out."""

    read: list[str]  # keys that the program was seen to read, without those that end it
    frame_seconds: float  # how long a frame usually is, in the program's own time
    exact: bool  # whether it goes on from snapshots with the same pictures


def first_play(processes: ProgramProcesses, shown: Mapping[str, Any]) -> FirstPlay:
    """Play a program whose first look has shown something. Raises AdapterError, and GameError if it soon fails."""
    settings = processes.settings
    look, times, read = make_look(settings, shown), [0], list[str]()
    if "keys" not in settings.names:
        numbers, times = keys_read(processes, look)
        read = sorted(name for name, number in shown["numbers"].items() if number in numbers and name not in ENDING)
        look = make_look(settings, shown, read)
    elif settings.window or "snapshots" in settings.flags:
        times = quiet_times(processes, look)
    if "snapshots" in settings.flags or settings.window:
        exact = settings.flags.get("snapshots", True)
    else:
        exact, same_times = plays_the_same(processes, look)
        times = max(times, same_times, key=len)
    usual = median([after - before for before, after in pairwise(times)] or [0])
    return FirstPlay(read, usual / 1e9 or 1 / settings.number("fps"), exact)


def quiet_times(processes: ProgramProcesses, look: Look) -> list[int]:
    """Return the times of frames without input, in nanoseconds. Raises GameError."""
    with playing(processes, look) as (players, form):
        first = players.begin([0], [0])
        return _times([*first, *players.play(0, [bytes(form.act_bytes)] * QUIET_FRAMES)])


def keys_read(processes: ProgramProcesses, look: Look) -> tuple[set[int], list[int]]:
    """Return the numbers of the keys that the program is seen to read, and the times of frames. Raises GameError."""
    with playing(processes, look, watch=True) as (players, form):
        first = players.begin([0], [0])
        times = _times([*first, *players.play(0, _random_acts(form, WATCHED_FRAMES, press=False))])
        return set(players.watched(0)), times


def plays_the_same(processes: ProgramProcesses, look: Look) -> tuple[bool, list[int]]:
    """Return whether a snapshot goes on, and an episode is repeated, with the same pictures; and the times of frames.

    Raises GameError.
    """
    with playing(processes, look, hashes=True) as (players, form):
        acts = _random_acts(form, sum(SAME_FRAMES))
        trial = branch_off(players, 0, acts[: SAME_FRAMES[0]], acts[SAME_FRAMES[0] :])
        processes.forget_branches()
        again = [*players.begin([0], [0]), *players.play(0, acts)]
        same = trial.original == trial.copied and trial.before + trial.original == _hashes(again)
        return same, _times(again)


class Trial(NamedTuple):
    """Hashes of the frames that were played before a snapshot, and after it by the process itself and by a copy."""

    before: list[int]
    original: list[int]
    copied: list[int]


def branch_off(players: Players, seed: int, before: Sequence[bytes], after: Sequence[bytes]) -> Trial:
    """Play an episode with a snapshot in it, and go on from there twice. Raises GameError.

    Nothing follows the snapshot if the episode is over before it.
    """
    players.begin([0], [seed])
    first = _hashes(players.play(0, before))
    if len(first) < len(before):
        return Trial(first, [], [])
    name = b"%d" % seed
    players.branch(0, name)
    original = _hashes(players.play(0, after))
    players.restore(0, name)
    return Trial(first, original, _hashes(players.play(0, after)))


def _hashes(frames: Iterable[Played]) -> list[int]:
    return [number for played in frames for number in played.hashes.tolist()]


def _times(frames: Iterable[Played]) -> list[int]:
    return [played.nanoseconds for played in frames]


def _random_acts(form: Form, count: int, *, press: bool = True) -> list[bytes]:
    """Return random acts. press: what is pressed, too, not only where the axes are."""
    rng, counts = np.random.default_rng(0), [len(branch.choices) for branch in form.branches()]
    axes = rng.uniform(-1, 1, (count, len(form.axes()))).astype(np.float32)
    choices = (rng.integers(counts, size=(count, len(counts))) * press).astype(np.int32)
    return [bytes(one) + bytes(other) for one, other in zip(axes, choices, strict=True)]


@contextmanager
def playing(
    processes: ProgramProcesses, look: Look, *, hashes: bool = False, watch: bool = False
) -> Iterator[tuple[Players, Form]]:
    """Yield a player that decides in every frame."""
    form = make_form(look, choose_options(options_of(look), {"decision_interval": "1"}, processes.settings.name))
    told = form.inside(processes.settings.number("seconds"), hashes=hashes, watch=watch)
    players = Players(processes, form, told, 1)
    try:
        yield players, form
    finally:
        players.end([0])
