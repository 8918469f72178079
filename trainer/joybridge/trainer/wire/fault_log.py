"""What led to a fault: the requests of a session since its last known state, as a file that `joybridge replay` repeats.

The log costs a session little: it refers to requests that were sent anyway, and takes a checksum of each step. It
begins anew with every snapshot, and is given up after LONGEST bytes of requests.
"""

import json
import logging
import zlib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from google.protobuf.message import DecodeError

from joybridge.contract.codec import StepArrays
from joybridge.contract.errors import JoybridgeError
from joybridge.contract.text import printable
from joybridge.contract.versions import own_version
from joybridge.trainer.errors import StorageError
from joybridge.trainer.files import read_file, storing, write_atomically
from joybridge.v1 import bridge_pb2 as pb

__all__ = ["FaultFileError", "FaultLog", "Recording", "digest", "load_recording"]

log = logging.getLogger("joybridge.trainer")

LONGEST = 64 << 20  # bytes of requests, without the snapshot of the first one
LARGEST_FILE = 4 << 30
FORMAT = 1


class FaultFileError(JoybridgeError):
    """A file that holds no recorded fault; the text names it."""


class Recording(NamedTuple):
    """A recorded fault."""

    error: str
    server: str  # its product
    requests: list[pb.PlayRequest]  # the first is Start
    digests: list[int | None]  # of the step that answered each request, as far as they came; None: not known


class FaultLog:
    """The requests of one session, and a digest of each step."""

    def __init__(self, path: Path, start: pb.Start, server: str, steps: Sequence[StepArrays]) -> None:
        """Begin with a session that has just started. path: of the file. server: its product."""
        self._path, self._server = path, server
        self._begin(start, digest(steps))

    def _begin(self, start: pb.Start, first: int | None) -> None:
        self._start, self._bytes = start, 0
        self._requests = [pb.PlayRequest(start=start)]
        self._digests = [first]

    def sent(self, request: pb.PlayRequest) -> None:
        """Note a request."""
        self._bytes += request.ByteSize()
        if self._bytes <= LONGEST:
            self._requests.append(request)

    def came(self, steps: Sequence[StepArrays]) -> None:
        """Note the step that answers the last request."""
        if self._bytes <= LONGEST:
            self._digests.append(digest(steps))

    def saved(self, parts: Mapping[str, bytes]) -> None:
        """Begin anew with a snapshot."""
        start = pb.Start()
        start.CopyFrom(self._start)
        start.snapshot.CopyFrom(pb.Snapshot(parts=parts))
        self._begin(start, None)

    def write(self, error: str) -> None:
        """Write the file in place of an earlier one, and say in the log how the fault is repeated."""
        if self._bytes > LONGEST:
            log.warning("the fault is not recorded: the session is longer than %d MiB of actions", LONGEST >> 20)
            return
        start = self._start
        bodies = [request.SerializeToString() for request in self._requests]
        header = {
            "format": FORMAT, "error": error, "client": own_version().product, "server": self._server,
            "game": start.game, "options": dict(start.options), "parameters": dict(start.parameters),
            "seed": start.seed, "arenas": start.arenas, "first_arena": start.first_arena,
            "sizes": [len(body) for body in bodies], "digests": self._digests,
        }  # fmt: skip
        try:
            with storing(self._path):
                self._path.parent.mkdir(parents=True, exist_ok=True)
            write_atomically(self._path, b"".join([json.dumps(header).encode(), b"\n", *bodies]))
        except StorageError as problem:
            log.warning("the fault is not recorded: %s", problem)
        else:
            log.warning("the fault is recorded; `joybridge replay %s` repeats it", self._path)


def load_recording(path: Path) -> Recording:
    """Read a recorded fault. Raises FaultFileError."""
    try:
        line, _, data = read_file(path, LARGEST_FILE).partition(b"\n")
        header = json.loads(line)
        if header["format"] != FORMAT:
            raise FaultFileError(
                f"{path} has format {header['format']!r}, expected {FORMAT}; replay it with its version"
            )
        requests, end = [], 0
        for size in header["sizes"]:
            requests.append(pb.PlayRequest.FromString(data[end : end + size]))
            end += size
        if end != len(data) or not requests or not requests[0].HasField("start"):
            raise ValueError(f"{len(data)} bytes of {len(requests)} requests, expected {end} that begin with start")
        return Recording(
            printable(str(header["error"])), printable(str(header["server"])), requests, list(header["digests"])
        )
    except (OSError, ValueError, TypeError, KeyError, RecursionError, DecodeError) as error:
        raise FaultFileError(
            f"{path} is no recorded fault ({error}); name a file of the folder faults of a run"
        ) from error


def digest(steps: Sequence[StepArrays]) -> int:
    """Return a checksum of what lanes observe and earn, and of which episodes end."""
    value = 0
    for step in steps:
        for array in (*step.observations, step.rewards, step.terminated, step.truncated):
            value = zlib.crc32(array.data, value)
    return value
