"""What is found out about a program by playing it for some seconds before it is served."""

import re
import shlex
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from itertools import pairwise
from statistics import median
from typing import Any, NamedTuple

import numpy as np

from joybridge.adapters.pygame_programs.form import Form, Look, make_form, make_look, options_of
from joybridge.adapters.pygame_programs.players import Played, Players
from joybridge.adapters.pygame_programs.processes import ProgramProcesses
from joybridge.adapters.pygame_programs.wire import ENDING
from joybridge.adapters.settings import AdapterError
from joybridge.contract.spec import choose_options
from joybridge.contract.text import printable
from joybridge.simulator.batched_game import GameError

QUIET_FRAMES = 32  # that are played without input to measure their length, if nothing else is played
WATCHED_FRAMES = 160  # in which one key after the other is pressed
DRAWN_INTERVAL, DRAWN_DECISIONS = 4, 60  # in which pictures with and without skipped frames are compared
SAME_FRAMES = (20, 40)  # before and after a snapshot, with random acts
TEXT_DECISIONS = 200  # in which numbers in texts are looked for, at most
TEXT_SECONDS = 3.0  # the same
TEXT_EPISODES = 20  # the same
MAX_NUMBERS = 8  # that are shown, and texts
TEXT_CHARS = 40  # of each text
NO_SCORE = re.compile(r"\b(time|clock|seconds|fps|high|best)", re.IGNORECASE)  # in texts whose number seldom is one
HOLD = 0.8  # probability with which random play goes on with what it does


class Number(NamedTuple):
    """A number in the texts of a program, and between which values it was."""

    reward: str  # that it would be, as in the setting
    low: float
    high: float

    def __str__(self) -> str:
        """Return it for a person."""
        values = f"{self.low:g}" if self.low == self.high else f"{self.low:g} to {self.high:g}"
        return f"{shlex.quote(f'reward={self.reward}')} ({values})"


class FirstPlay(NamedTuple):
    """What was found out."""

    read: list[str]  # keys that the program was seen to read, without those that end it
    frame_seconds: float  # how long a frame usually is, in the program's own time
    exact: bool  # whether it goes on from snapshots with the same pictures
    numbers: list[Number]  # in its texts, unless it is said what pays
    remarks: list[str]  # about rewards and ends that were not found, and about failures


def first_play(processes: ProgramProcesses, shown: Mapping[str, Any]) -> FirstPlay:
    """Play a program whose first look has shown something. Raises AdapterError, and GameError if it soon fails."""
    settings = processes.settings
    look, times, read = make_look(settings, shown), [0], list[str]()
    if "keys" not in settings.names:
        keys, times = keys_read(processes, look)
        read = sorted(name for name, number in shown["numbers"].items() if number in keys and name not in ENDING)
        look = make_look(settings, shown, read)
    elif settings.window or "snapshots" in settings.flags:
        times = quiet_times(processes, look)
    if "snapshots" in settings.flags or settings.window:
        exact = settings.flags.get("snapshots", True)
    else:
        exact, same_times = plays_the_same(processes, look)
        times = max(times, same_times, key=len)
    if settings.skip_drawing and not draws_anew(processes, look):
        raise AdapterError(
            "skip_drawing=true: the program does not draw its whole picture in every frame, so what is seen would "
            "change; leave it out"
        )
    paid = bool(settings.rewards or "hook" in settings.texts)
    shown_texts = watch_texts(processes, look) if settings.rewards or settings.done or not paid else Shown([], [])
    numbers = [] if paid else shown_texts.numbers
    usual = median([after - before for before, after in pairwise(times)] or [0])
    return FirstPlay(read, usual / 1e9 or 1 / settings.number("fps"), exact, numbers, shown_texts.remarks)


def quiet_times(processes: ProgramProcesses, look: Look) -> list[int]:
    """Return the times of frames without input, in nanoseconds. Raises GameError."""
    with playing(processes, look) as (players, form):
        first = players.begin([0], [0])
        return _times([*first, *players.play(0, [bytes(form.act_bytes)] * QUIET_FRAMES)])


def keys_read(processes: ProgramProcesses, look: Look) -> tuple[set[int], list[int]]:
    """Return the numbers of the keys that the program is seen to read, and the times of frames. Raises GameError."""
    with playing(processes, look, watch="keys") as (players, form):
        first = players.begin([0], [0])
        times = _times([*first, *players.play(0, _fresh_acts(form, WATCHED_FRAMES, press=False))])
        return set(players.watched(0)), times


class Shown(NamedTuple):
    """What the texts of a program have shown in random play."""

    numbers: list[Number]  # first what may be a score, and of that first what changes
    remarks: list[str]


def watch_texts(processes: ProgramProcesses, look: Look) -> Shown:
    """Play at random, and return what the texts show. A program that fails shows what it has shown before."""
    end, left = time.monotonic() + TEXT_SECONDS, TEXT_DECISIONS
    found, texts, missed, remarks = dict[str, Number](), dict[str, None](), list[str](), list[str]()
    with suppress(GameError), playing(processes, look, interval=4, watch="texts") as (players, form):
        for seed in range(TEXT_EPISODES):
            players.begin([0], [seed])
            try:
                for _ in players.play(0, random_acts(form, seed, left)):
                    left -= 1
                    if time.monotonic() > end:
                        break
            except GameError as error:
                remarks.append(f"after {TEXT_DECISIONS - left} decisions of random play, {error}")
            watched = players.watched(0)
            for reward, low, high in watched["numbers"]:
                known = found.get(reward, Number(reward, low, high))
                found[reward] = Number(reward, min(low, known.low), max(high, known.high))
            texts |= dict.fromkeys(watched["texts"])
            missed = [each for each in watched["missed"] if seed == 0 or each in missed]
            if left <= 0 or remarks or time.monotonic() > end:
                break
    for kind in ([each for each in missed if is_end(each) == ends] for ends in (False, True)):
        if not kind:
            continue
        seen = ", ".join(f"{printable(text)[:TEXT_CHARS]!r}" for text in list(texts)[:MAX_NUMBERS]) or "none"
        played = f"{TEXT_DECISIONS - left} decisions of random play"
        later = ", and may come later" if is_end(kind[0]) else ""
        remarks.append(f"{', '.join(kind)} matched nothing in {played}{later}; texts seen (case counts): {seen}")
    likely = sorted(
        found.values(), key=lambda number: (bool(NO_SCORE.search(number.reward)), number.low == number.high)
    )
    return Shown(likely[:MAX_NUMBERS], remarks)


def is_end(missed: str) -> bool:
    """Return whether something that was not found, or a remark that begins with it, is an end of episodes."""
    return missed.startswith("done '")


def plays_the_same(processes: ProgramProcesses, look: Look) -> tuple[bool, list[int]]:
    """Return whether a snapshot goes on, and an episode is repeated, with the same pictures; and the times of frames.

    Raises GameError.
    """
    with playing(processes, look, hashes=True) as (players, form):
        acts = _fresh_acts(form, sum(SAME_FRAMES))
        trial = branch_off(players, 0, acts[: SAME_FRAMES[0]], acts[SAME_FRAMES[0] :])
        processes.forget_branches()
        again = [*players.begin([0], [0]), *players.play(0, acts)]
        same = trial.original == trial.copied and trial.before + trial.original == _hashes(again)
        return same, _times(again)


def draws_anew(processes: ProgramProcesses, look: Look) -> bool:
    """Return whether the last frames of decisions look the same if only they are drawn. Raises GameError."""
    seen = []
    for skip_drawing in (False, True):
        with playing(processes, look, interval=DRAWN_INTERVAL, skip_drawing=skip_drawing) as (players, form):
            first = players.begin([0], [0])
            acts = _fresh_acts(form, DRAWN_DECISIONS)
            seen.append([played.sensors[0] for played in (*first, *players.play(0, acts)) if not played.over])
    drawn, skipped = seen
    return len(drawn) == len(skipped) and all(map(np.array_equal, drawn, skipped))


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


def _fresh_acts(form: Form, count: int, *, press: bool = True) -> list[bytes]:
    """Return random acts, each for itself. press: what is pressed, too, not only where the axes are."""
    rng, counts = np.random.default_rng(0), [len(branch.choices) for branch in form.branches()]
    axes = rng.uniform(-1, 1, (count, len(form.axes()))).astype(np.float32)
    choices = (rng.integers(counts, size=(count, len(counts))) * press).astype(np.int32)
    return [bytes(one) + bytes(other) for one, other in zip(axes, choices, strict=True)]


def random_acts(form: Form, seed: int, decisions: int) -> Iterator[bytes]:
    """Yield random acts that go on for a while, as those of a person do."""
    rng = np.random.default_rng(seed)
    axes, counts = len(form.axes()), [len(branch.choices) for branch in form.branches()]
    places, choices = np.zeros(axes, np.float32), np.zeros(len(counts), np.int32)
    for _ in range(decisions):
        fresh = rng.random(axes + len(counts)) > HOLD
        places = np.where(fresh[:axes], rng.uniform(-1, 1, axes), places).astype(np.float32)
        choices = np.where(fresh[axes:], rng.integers(counts), choices).astype(np.int32)
        yield places.tobytes() + choices.tobytes()


@contextmanager
def playing(
    processes: ProgramProcesses, look: Look, *, interval: int = 1, **told: Any
) -> Iterator[tuple[Players, Form]]:
    """Yield a player. interval: frames per decision. told: as of `Form.inside`."""
    options = {"decision_interval": str(interval)}
    form = make_form(look, choose_options(options_of(look), options, processes.settings.name))
    players = Players(processes, form, form.inside(processes.settings.number("seconds"), **told), 1)
    try:
        yield players, form
    finally:
        players.end([0])
