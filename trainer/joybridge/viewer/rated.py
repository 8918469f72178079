"""Matches of people who want to be rated: each goes to the log that `joybridge rate` fits ratings to."""

import time
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from joybridge.contract.codec import StepArrays
from joybridge.policy.seats import Seats
from joybridge.run.matches import Match, locked_log, read_matches, write_matches
from joybridge.v1 import bridge_pb2 as pb


class RatedMatches:
    """The matches of one arena. Only those count in which everybody held one seat from the beginning to the end."""

    def __init__(self, folder: Path, spec: pb.GameSpec, others: Sequence[str], people: Sequence[str]) -> None:
        """folder: of the log. others: who holds each seat that people do not. people: their names, by their seats."""
        self._folder, self._others, self._people = folder, others, people
        self._seats = Seats(spec, 1)
        self._held: set[tuple[int, ...]] = set()  # the seats that people have held in the present match
        self._begin()

    def hold(self, seats: Iterable[int]) -> None:
        """Note the seats that people hold in the next decision."""
        self._held.add(tuple(sorted(seats)))

    def take(self, steps: Sequence[StepArrays]) -> None:
        """Take what followed; a match that is over goes to the log. Raises StorageError and CheckpointError."""
        for result in self._seats.finish(steps):
            held = next(iter(self._held))
            if len(self._held) == 1 and len(held) == len(self._people):
                players = [*self._others]
                for seat, person in zip(held, self._people, strict=True):
                    players[seat] = person
                match = Match(players=tuple(players), places=tuple(result.places.tolist()), seed=int(time.time()))
                with locked_log(self._folder):
                    write_matches(self._folder, [*read_matches(self._folder), match])
            self._begin()

    def _begin(self) -> None:
        self._held.clear()
        self._seats.begin(0, np.arange(self._seats.count))
