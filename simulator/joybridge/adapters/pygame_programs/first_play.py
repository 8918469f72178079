"""What is found out about a program by playing it for some seconds before it is served."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import pairwise
from statistics import median
from typing import NamedTuple

import numpy as np

from joybridge.adapters.pygame_programs.form import Form, Look, make_form, options_of
from joybridge.adapters.pygame_programs.players import Players
from joybridge.adapters.pygame_programs.processes import ProgramProcesses
from joybridge.contract.spec import choose_options

QUIET_FRAMES = 32  # that are played without input, to measure their length
WATCHED_FRAMES = 160  # in which one key after the other is pressed
SAME_FRAMES = (20, 40)  # before and after a snapshot, with random acts


def frame_seconds(processes: ProgramProcesses, look: Look) -> float:
    """Return how long a frame of the program usually is, in its own time. Raises GameError if it soon fails."""
    with playing(processes, look) as (players, form):
        times = [players.begin([0], [0])[0].nanoseconds]
        times += [each.nanoseconds for each in players.play(0, [bytes(form.act_bytes)] * QUIET_FRAMES)]
    return median([after - before for before, after in pairwise(times)]) / 1e9 or 1 / processes.settings.number("fps")


def keys_read(processes: ProgramProcesses, look: Look, numbers: dict[str, int]) -> list[str]:
    """Return the names of the keys that the program is seen to read. numbers: pygame's, by name. Raises GameError."""
    with playing(processes, look, watch=True) as (players, form):
        players.begin([0], [0])
        for _ in players.play(0, _random_acts(form, WATCHED_FRAMES, press=False)):
            pass
        read = set(players.watched(0))
    return sorted(name for name, number in numbers.items() if number in read)


def plays_the_same(processes: ProgramProcesses, look: Look) -> bool:
    """Return whether a snapshot goes on, and an episode is repeated, with the same pictures. Raises GameError."""
    with playing(processes, look, hashes=True) as (players, form):
        acts = _random_acts(form, sum(SAME_FRAMES))
        trial = branch_off(players, 0, acts[: SAME_FRAMES[0]], acts[SAME_FRAMES[0] :])
        processes.forget_branches()
        players.begin([0], [0])
        return trial.original == trial.copied and trial.before + trial.original == _hashes(players, acts)


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
    first = _hashes(players, before)
    if len(first) < len(before):
        return Trial(first, [], [])
    name = b"%d" % seed
    players.branch(0, name)
    original = _hashes(players, after)
    players.restore(0, name)
    return Trial(first, original, _hashes(players, after))


def _hashes(players: Players, acts: Sequence[bytes]) -> list[int]:
    return [number for played in players.play(0, acts) for number in played.hashes.tolist()]


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
