"""Which of several simulators a run waits for."""

import time
from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

from joybridge.client.client import Session

NAMED_SHARE = 0.15  # of the time that is waited for one simulator alone, from which on it is named
LEFT_SHARE = 0.3  # likewise, from which on another one plays its arenas
LONGER_FACTOR = 2.0  # times all other waiting: only then is one that plays twice as much faster
CYCLES = 3  # in a row, because anything may stall once


class Slow(NamedTuple):
    """A simulator for which the run waits after the others have answered."""

    address: str
    share: float  # of the time
    fastest: str  # address of the one that is waited for least
    far: bool  # whether the fastest one would be faster with the arenas of both

    @property
    def text(self) -> str:
        """What to say about it."""
        return (
            f"waiting: {self.share:.0%} of the time is spent on the simulator at {self.address} alone, after the "
            "others have answered; it is slower, or farther away"
        )


class Waits:
    """The waiting for each simulator. A step is complete when the slowest one has answered."""

    def __init__(self, sessions: Sequence[Session]) -> None:
        """Watch open sessions, from now on."""
        self._sessions = sessions
        self._places = Counter(session.address for session in sessions)
        self._last: list[Slow] = []  # the slowest of the last cycles
        self._begin, self._before = time.perf_counter(), self._waited()

    def _waited(self) -> dict[str, float]:
        waited = dict.fromkeys(self._places, 0.0)
        for session in self._sessions:
            waited[session.address] += session.waited
        return waited

    def look(self) -> Slow | None:
        """Return the simulator that was the slowest in each of the last cycles, if one was; its least share."""
        now, waited = time.perf_counter(), self._waited()
        seconds = {place: waited[place] - self._before[place] for place in self._places}
        elapsed, self._begin, self._before = now - self._begin, now, waited
        slowest, fastest = (choose(seconds, key=lambda place: seconds[place]) for choose in (max, min))
        if slowest == fastest or self._places[slowest] > self._places[fastest]:  # it has more to play
            return None
        others = sum(seconds.values()) - seconds[slowest]
        alone = seconds[slowest] - others / (len(seconds) - 1)  # each of the others is waited for as long
        self._last = [*self._last, Slow(slowest, alone / elapsed, fastest, alone > LONGER_FACTOR * others)][-CYCLES:]
        if len(self._last) < CYCLES or any(one.address != slowest for one in self._last):
            return None
        least = min(self._last, key=lambda one: one.share)
        return least._replace(far=all(one.far for one in self._last)) if least.share >= NAMED_SHARE else None
