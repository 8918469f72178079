"""What led to a fault: the requests of a session since its last known state, as a file that `joybridge replay` repeats.

The log costs a session little: it refers to requests that were sent anyway, and takes a checksum of each step. It
starts over with every snapshot, and gives up after MAX_LOG_BYTES bytes of requests.
"""

import logging
from collections.abc import Iterator, Mapping, Sequence
from itertools import zip_longest
from pathlib import Path

from joybridge.client.recording import CHECK, Kind, Record, Writer, digest, heading
from joybridge.config.errors import StorageError
from joybridge.config.files import storing, write_atomically
from joybridge.contract.codec import StepArrays
from joybridge.v1 import bridge_pb2 as pb

__all__ = ["FAULTS", "FaultLog"]

log = logging.getLogger("joybridge.trainer")

FAULTS = "faults"  # the folder of a run that has its faults
MAX_LOG_BYTES = 64 << 20  # bytes of requests, without the snapshot of the first one


class FaultLog:
    """The requests of one session, and a digest of each step."""

    def __init__(self, path: Path, start: pb.Start, server: str, steps: Sequence[StepArrays]) -> None:
        """Begin with a session that has just started. path: of the file. server: its product."""
        self._path, self._server = path, server
        self._drawn = dict(start.distributions)  # by parameter: a snapshot has none
        self._begin(start, digest(steps))

    def _begin(self, start: pb.Start, first: int | None) -> None:
        self._start, self._bytes = start, 0
        self._requests = [pb.PlayRequest(start=start)]
        self._digests = [first]

    def sent(self, request: pb.PlayRequest) -> None:
        """Note a request."""
        self._bytes += request.ByteSize()
        self._drawn.update(request.act.distributions)
        self._drawn.update(request.reset.distributions)
        for name in request.reset.parameters:
            self._drawn.pop(name, None)
        if self._bytes <= MAX_LOG_BYTES:
            self._requests.append(request)

    def came(self, steps: Sequence[StepArrays]) -> None:
        """Note the step that answers the last request."""
        if self._bytes <= MAX_LOG_BYTES:
            self._digests.append(digest(steps))

    def saved(self, parts: Mapping[str, bytes]) -> None:
        """Start over with a snapshot."""
        start = pb.Start()
        start.CopyFrom(self._start)
        start.snapshot.CopyFrom(pb.Snapshot(parts=parts))
        start.ClearField("distributions")
        for name, distribution in self._drawn.items():
            start.parameters.pop(name, None)  # a message gives one of the two
            start.distributions[name].CopyFrom(distribution)
        self._begin(start, None)

    def failed(self, error: str) -> None:
        """Write the file in place of an earlier one, and say in the log how the fault is repeated."""
        if self._bytes > MAX_LOG_BYTES:
            log.warning("the fault is not recorded: the session is longer than %d MiB of actions", MAX_LOG_BYTES >> 20)
            return
        writer = Writer(heading(self._start, self._server, error=error))
        try:
            with storing(self._path):
                self._path.parent.mkdir(parents=True, exist_ok=True)
            write_atomically(self._path, writer.first_line + writer.encode(self._records()))
        except StorageError as problem:
            log.warning("the fault is not recorded: %s", problem)
        else:
            log.warning("the fault is recorded; `joybridge replay %s` repeats it", self._path)

    def _records(self) -> Iterator[Record]:
        for request, known in zip_longest(self._requests, self._digests):
            yield Record(Kind.REQUEST, request.SerializeToString())
            if known is not None:
                yield Record(Kind.DIGEST, CHECK.pack(known))
