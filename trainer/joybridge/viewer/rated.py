"""Matches of a person who wants to be rated: each goes to the log that `joybridge rate` fits ratings to."""

import time
from collections.abc import Sequence
from pathlib import Path
from threading import Lock

import numpy as np

from joybridge.contract.codec import StepArrays
from joybridge.policy.seats import Seats
from joybridge.run.matches import Match, read_matches, write_matches
from joybridge.v1 import bridge_pb2 as pb

_WRITING = Lock()  # each tab plays in a thread


class RatedMatches:
    """The matches of one arena. Only those count in which the person held one seat from the beginning to the end."""

    def __init__(self, folder: Path, spec: pb.GameSpec, others: Sequence[str], person: str) -> None:
        """folder: of the log. others: who holds each seat that the person does not. person: its name."""
        self._folder, self._others, self._person = folder, others, person
        self._seats = Seats(spec, 1)
        self._held: set[int | None] = set()  # what the person has held in the present match; None: all seats
        self._begin()

    def hold(self, seat: int | None) -> None:
        """Note the seat that the person holds in the next decision, None: all."""
        self._held.add(seat)

    def take(self, steps: Sequence[StepArrays]) -> None:
        """Take what followed; a match that is over goes to the log. Raises StorageError and CheckpointError."""
        for result in self._seats.finish(steps):
            if len(self._held) == 1 and (seat := next(iter(self._held))) is not None:
                players = [*self._others]
                players[seat] = self._person
                match = Match(players=tuple(players), places=tuple(result.places.tolist()), seed=int(time.time()))
                with _WRITING:
                    self._folder.mkdir(parents=True, exist_ok=True)
                    write_matches(self._folder, [*read_matches(self._folder), match])
            self._begin()

    def _begin(self) -> None:
        self._held.clear()
        self._seats.begin(0, np.arange(self._seats.count))
