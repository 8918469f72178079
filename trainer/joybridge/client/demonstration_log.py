"""Demonstrations: sessions of somebody who plays well, appended to a file with every step.

A file holds all that a session was and did: the spec, options, parameters and seed, the axes and choices that the game
got, and every step. So it can be learned from without a simulator, and repeated with one. Every step is handed to the
system at once: a program that is killed loses none that it has played.
"""

import json
import os
from collections.abc import Iterable, Mapping, Sequence
from copy import copy
from pathlib import Path

from joybridge.client.recording import COUNT, MAX_FILE_BYTES, Kind, Record, Writer, heading
from joybridge.config.errors import StorageError
from joybridge.config.files import storing
from joybridge.config.metrics import metrics_name
from joybridge.contract.codec import StepArrays, fill_step
from joybridge.v1 import bridge_pb2 as pb

__all__ = ["SUFFIX", "DemonstrationLog"]

SUFFIX = ".demo"


class DemonstrationLog:
    """The requests and steps of one session. The file is made with the first decision; `path` is None until then."""

    def __init__(
        self, folder: Path, start: pb.Start, server: str, spec: pb.GameSpec, steps: Sequence[StepArrays]
    ) -> None:
        """Begin with a session that has just started. server: its product. Raises StorageError."""
        with storing(folder):
            folder.mkdir(parents=True, exist_ok=True)
        self._folder, self._game = folder, start.game
        self.path: Path | None = None
        self._writer = Writer(heading(start, server))
        self._held: list[list[int]] | None = None
        self._waiting = [  # records that are written with the next step
            Record(Kind.SPEC, spec.SerializeToString(deterministic=True)),
            Record(Kind.REQUEST, pb.PlayRequest(start=start).SerializeToString(deterministic=True)),
            _step(steps),
        ]

    def hold(self, lanes: Sequence[Iterable[int]] | None) -> None:
        """Say whose decisions are demonstrated from now on: some lanes of each behavior, or None, which means all."""
        held = None if lanes is None else [[int(lane) for lane in own] for own in lanes]
        if held != self._held:
            self._held = held
            self._waiting.append(Record(Kind.HELD, json.dumps(held).encode()))

    def discard(self, decisions: int) -> None:
        """Say that the last decisions are demonstrated by nobody after all. Raises StorageError."""
        if self.path is not None:
            self._append([Record(Kind.DISCARDED, COUNT.pack(decisions))])

    def sent(self, request: pb.PlayRequest) -> None:
        """Note a request."""
        if request.act.draw:  # pictures change nothing
            act = pb.Act(behaviors=request.act.behaviors, distributions=request.act.distributions)
            request = pb.PlayRequest(act=act)
        self._waiting.append(Record(Kind.REQUEST, request.SerializeToString(deterministic=True)))

    def came(self, steps: Sequence[StepArrays]) -> None:
        """Append the last request and the step that answers it. Raises StorageError."""
        self._waiting.append(_step(steps))
        self._append(self._waiting)
        self._waiting = []

    def saved(self, parts: Mapping[str, bytes]) -> None:
        """Do nothing: a snapshot changes nothing in a session."""

    def failed(self, error: str) -> None:
        """Do nothing: all that was played is in the file."""

    def _append(self, records: Sequence[Record]) -> None:
        writer = copy(self._writer)  # what could not be written is not part of the checksum
        data = writer.encode(records)
        with storing(self._folder):
            self._write(data)
        self._writer = writer

    def _write(self, data: bytes) -> None:
        """Write records whole or not at all, the first ones into a new file. Raises OSError and StorageError."""
        if self.path is None:
            self.path = self._new_file(data)
            return
        whole = self.path.stat().st_size
        if whole + len(data) > MAX_FILE_BYTES:
            raise StorageError(
                f"{self.path}: a demonstration has at most {MAX_FILE_BYTES:,} bytes, so recording ends; what came "
                "before can be used. Record fewer arenas or episodes at once, several times"
            )
        try:
            with self.path.open("ab") as file:  # buffered: it writes all, or raises
                file.write(data)
        except OSError:
            os.truncate(self.path, whole)  # a part of a record would make the file unreadable
            raise

    def _new_file(self, data: bytes) -> Path:
        """Make the next file of the game in the folder, with its first line and records, and return its path."""
        name = metrics_name(self._game)
        number = 1
        while True:
            path = self._folder / f"{name}-{number:04d}{SUFFIX}"
            try:
                with path.open("xb") as file:
                    file.write(self._writer.first_line + data)
                return path
            except FileExistsError:
                number += 1
            except OSError:
                path.unlink(missing_ok=True)
                raise


def _step(steps: Sequence[StepArrays]) -> Record:
    message = pb.Step()
    for step in steps:
        fill_step(message.behaviors.add(), step)
    return Record(Kind.STEP, message.SerializeToString())
