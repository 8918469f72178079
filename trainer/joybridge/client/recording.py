"""The file format of recorded sessions: what led to a fault, and demonstrations.

The first line is a JSON object that says what was played. Records follow, and are only ever appended:

    kind     1 byte: a Kind
    size     uint32, little-endian: bytes of the body
    check    uint32: CRC-32 of kind and size, continued from the record before, or from the first line
    body
    check    uint32: CRC-32 of the body, continued from the check above

So a file says whether it is whole. If the program that wrote it was killed, its last record may be cut off; what is
before it counts.
"""

import json
import struct
import zlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from google.protobuf.message import DecodeError

from joybridge.contract.codec import StepArrays
from joybridge.contract.errors import JoybridgeError
from joybridge.contract.files import read_file
from joybridge.contract.text import printable
from joybridge.contract.versions import own_version
from joybridge.v1 import bridge_pb2 as pb

__all__ = [
    "Exchange",
    "Kind",
    "Record",
    "Recording",
    "RecordingError",
    "Writer",
    "digest",
    "heading",
    "load_recording",
]

MAX_FILE_BYTES = 1 << 30  # bytes; a folder may hold several
FORMAT = 2
ENTRY_HEADER = struct.Struct("<cI")
CHECK = COUNT = struct.Struct("<I")


class Kind:
    """What a record holds."""

    SPEC = b"G"  # a GameSpec, before the first request
    # From the next request on: whose decisions are demonstrated, a JSON list of lanes per behavior; or null.
    HELD = b"H"
    DISCARDED = b"X"  # how many of the last decisions are demonstrated by nobody after all, a uint32
    REQUEST = b"Q"  # a PlayRequest; the first has Start
    STEP = b"S"  # the Step that answered it, without pictures and times
    DIGEST = b"D"  # instead of STEP: its `digest`, a uint32


class RecordingError(JoybridgeError):
    """A file that holds no recorded session; the text names it."""


class Record(NamedTuple):
    """A part of a file."""

    kind: bytes
    body: bytes


@dataclass
class Exchange:
    """A request and what is known of its answer."""

    request: pb.PlayRequest
    held: list[list[int]] | None  # the lanes of each behavior whose decisions are demonstrated; None: all
    step: pb.Step | None = None
    digest: int | None = None  # of the step; None: not known


@dataclass(frozen=True)
class Recording:
    """A recorded session."""

    path: Path
    error: str  # the fault that ended it; "": none
    server: str  # its product
    spec: pb.GameSpec | None  # of a demonstration
    exchanges: list[Exchange]  # the first request is Start
    cut: int  # bytes of a record at the end that was not written to its end, and is left out

    @property
    def start(self) -> pb.Start:
        """Return the first request."""
        return self.exchanges[0].request.start


class Writer:
    """Turns records into bytes that are appended to a file."""

    def __init__(self, heading: Mapping[str, Any]) -> None:
        """heading: what the first line says, see `heading`."""
        self.first_line = json.dumps(heading).encode() + b"\n"
        self._check = zlib.crc32(self.first_line)

    def encode(self, records: Iterable[Record]) -> bytes:
        """Return the bytes of the next records."""
        parts = []
        for kind, body in records:
            head = ENTRY_HEADER.pack(kind, len(body))
            of_head = zlib.crc32(head, self._check)
            self._check = zlib.crc32(body, of_head)
            parts += [head, CHECK.pack(of_head), body, CHECK.pack(self._check)]
        return b"".join(parts)


def heading(start: pb.Start, server: str, **more: str) -> dict[str, Any]:
    """Return what the first line of a file says."""
    return {
        "format": FORMAT,
        **more,
        "client": own_version().product,
        "server": server,
        "game": start.game,
        "options": dict(start.options),
        "parameters": dict(start.parameters),
        "seed": start.seed,
        "arenas": start.arenas,
        "first_arena": start.first_arena,
    }


def load_recording(path: Path) -> Recording:
    """Read a recorded session. Raises RecordingError."""
    try:
        data = read_file(path, MAX_FILE_BYTES)
        end = data.index(b"\n") + 1
        header = json.loads(data[:end])
        if header["format"] != FORMAT:
            raise RecordingError(
                f"{path} has format {header['format']!r}, expected {FORMAT}; use the version of its time"
            )
        records, cut = _read(path, data, end)
        spec, exchanges = _exchanges(records)
        if not exchanges or not exchanges[0].request.HasField("start"):
            raise ValueError(f"{len(exchanges)} requests, expected some that begin with start")
        return Recording(
            path, printable(str(header.get("error", ""))), printable(str(header["server"])), spec, exchanges, cut
        )
    except (
        OSError,
        ValueError,
        TypeError,
        LookupError,
        AttributeError,
        RecursionError,
        DecodeError,
        struct.error,
    ) as error:
        raise RecordingError(
            f"{path} is no recorded session ({error}); name a demonstration, or a file of the folder faults of a run"
        ) from error


def _read(path: Path, data: bytes, begin: int) -> tuple[list[Record], int]:
    """Return the records from a place on, and how many bytes at the end are no whole record. Raises RecordingError."""
    records, place, check = [], begin, zlib.crc32(data[:begin])
    while place + ENTRY_HEADER.size + CHECK.size <= len(data):
        kind, size = ENTRY_HEADER.unpack_from(data, place)
        body = place + ENTRY_HEADER.size + CHECK.size
        of_head = zlib.crc32(data[place : place + ENTRY_HEADER.size], check)
        whole = body + size + CHECK.size <= len(data)
        check = zlib.crc32(memoryview(data)[body : body + size], of_head)
        if of_head != CHECK.unpack_from(data, body - CHECK.size)[0] or (
            whole and check != CHECK.unpack_from(data, body + size)[0]
        ):
            raise RecordingError(
                f"{path} is damaged: its checksum at byte {place:,} of {len(data):,} is wrong; restore it from a copy, "
                "or delete it"
            )
        if not whole:
            break
        records.append(Record(kind, data[body : body + size]))
        place = body + size + CHECK.size
    return records, len(data) - place


def _exchanges(records: Sequence[Record]) -> tuple[pb.GameSpec | None, list[Exchange]]:
    spec: pb.GameSpec | None = None
    held: list[list[int]] | None = None
    exchanges: list[Exchange] = []
    for kind, body in records:
        match kind:
            case Kind.SPEC:
                spec = pb.GameSpec.FromString(body)
            case Kind.HELD:
                held = _lanes(body)
            case Kind.DISCARDED:
                pass
            case Kind.REQUEST:
                exchanges.append(Exchange(_request(body), held))
            case Kind.STEP:
                exchanges[-1].step = step = pb.Step.FromString(body)
                exchanges[-1].digest = _checksum(_data(step))
            case Kind.DIGEST:
                (exchanges[-1].digest,) = CHECK.unpack(body)
            case _:
                raise ValueError(f"a record of the unknown kind {kind!r}")
    _discard(records, exchanges, [[] for _ in spec.behaviors] if spec else None)
    return spec, exchanges


def _discard(records: Sequence[Record], exchanges: Sequence[Exchange], nobody: list[list[int]] | None) -> None:
    """Let nobody demonstrate the decisions that were discarded: the last ones before each record that says how many."""
    left, earlier = 0, reversed(exchanges)
    for kind, body in reversed(records):  # from the end, so that each is looked at once
        if kind == Kind.DISCARDED:
            left = max(left, *COUNT.unpack(body))
        elif kind == Kind.REQUEST:
            exchange = next(earlier)
            if left:
                exchange.held = nobody
                left -= exchange.request.HasField("act")  # a reset in between is no decision


def _lanes(body: bytes) -> list[list[int]] | None:
    """Return whose decisions are demonstrated. Raises ValueError unless it is a list for each behavior, or None."""
    held: list[list[int]] | None = json.loads(body)
    rows = [] if held is None else held
    if not isinstance(rows, list) or not all(
        isinstance(lanes, list) and all(type(lane) is int for lane in lanes) for lanes in rows
    ):
        raise ValueError("the lanes that are demonstrated are no lists of numbers")
    return held


def _request(body: bytes) -> pb.PlayRequest:
    """Return a request. Raises ValueError for an empty one: a small file could hold very many of them."""
    request = pb.PlayRequest.FromString(body)
    if request.WhichOneof("request") in (None, "act") and not request.act.behaviors:
        raise ValueError("an empty request")
    return request


def digest(steps: Sequence[StepArrays]) -> int:
    """Return a checksum of what lanes observe and earn, and of which episodes end."""
    arrays = ((*step.observations, step.rewards, step.terminated, step.truncated) for step in steps)
    return _checksum(array.data for group in arrays for array in group)


def _data(step: pb.Step) -> Iterator[bytes]:
    """Yield the bytes of the same arrays in a message."""
    for behavior in step.behaviors:
        for tensor in (*behavior.observations, behavior.rewards, behavior.terminated, behavior.truncated):
            yield tensor.data


def _checksum(parts: Iterable[Any]) -> int:
    value = 0
    for part in parts:
        value = zlib.crc32(part, value)
    return value
