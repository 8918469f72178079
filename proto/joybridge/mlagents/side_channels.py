"""Side channels: bytes beside the steps, for settings of the engine, environment parameters and statistics.

The bytes of a message are those of its channels side by side: the UUID with its first three groups in little-endian
order, the length of the payload, the payload. All numbers are little-endian; a text has its length before it.
"""

import struct
from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple
from uuid import UUID

import numpy as np

from joybridge.mlagents.wire import CommunicatorError

ENGINE = UUID("e951342c-4f7e-11ea-b238-784f4387d1f7")  # resolution, quality and speed, from the trainer
PARAMETERS = UUID("534c891e-810f-11ea-a9d0-822485860400")  # environment parameters, from the trainer
STATISTICS = UUID("a1d8f7b7-cec8-50f9-b78b-d3e165a78520")  # numbers with names, from the player
RESOLUTION, QUALITY, TIME_SCALE, TARGET_FRAME_RATE, CAPTURE_FRAME_RATE = range(5)  # settings of the engine
AVERAGE, MOST_RECENT, SUM = range(3)  # how a trainer summarizes a statistic
MAX_PAYLOADS = 10_000  # of a message
_HEAD = struct.Struct("<16si")


class Payload(NamedTuple):
    """One message of a side channel."""

    channel: UUID
    data: bytes


def join(payloads: Iterable[Payload]) -> bytes:
    """Return the side channels of a message."""
    return b"".join(_HEAD.pack(one.channel.bytes_le, len(one.data)) + one.data for one in payloads)


def split(data: bytes) -> Iterator[Payload]:
    """Yield the side channels of a message. Raises CommunicatorError if it is cut, or has very many."""
    place = 0
    for _ in range(MAX_PAYLOADS):
        if place == len(data):
            return
        begin = place + _HEAD.size
        if begin > len(data):
            raise _damaged()
        channel, length = _HEAD.unpack_from(data, place)
        place = begin + length
        if not begin <= place <= len(data):
            raise _damaged()
        yield Payload(UUID(bytes_le=channel), data[begin:place])
    raise _damaged()


def time_scale(value: float) -> Payload:
    """Return the setting of the engine's speed: 20 is twenty times real time."""
    return Payload(ENGINE, struct.pack("<if", TIME_SCALE, value))


def resolution(width: int, height: int) -> Payload:
    """Return the setting of the window's size in pixels."""
    return Payload(ENGINE, struct.pack("<iii", RESOLUTION, width, height))


def engine(kind: int, value: int) -> Payload:
    """Return a setting of the engine that is a whole number: QUALITY, TARGET_FRAME_RATE or CAPTURE_FRAME_RATE."""
    return Payload(ENGINE, struct.pack("<ii", kind, value))


def parameter(name: str, value: float) -> Payload:
    """Return the new value of an environment parameter."""
    return Payload(PARAMETERS, _text(name) + struct.pack("<if", 0, value))


def read_parameter(data: bytes) -> tuple[str, float]:
    """Return the name and the new value of an environment parameter. Raises CommunicatorError for a sampler."""
    name, rest = _read_text(data)
    kind, value = _unpack("<if", rest[:8])
    if kind != 0:
        raise CommunicatorError(
            f"the environment parameter {name!r} is a sampler, but parameters of Joybridge's games are numbers; give "
            "it a value, or a curriculum of values"
        )
    return name, float(str(np.float32(value)))  # 0.3, not 0.30000001192092896, which may be above a bound of 0.3


def statistic(name: str, value: float) -> Payload:
    """Return a number of which the trainer reports the mean."""
    return Payload(STATISTICS, _text(name) + struct.pack("<fi", value, AVERAGE))


def read_statistic(data: bytes) -> tuple[str, float, int]:
    """Return the name and the value of a statistic, and how it is summarized. Raises CommunicatorError."""
    name, rest = _read_text(data)
    value, kind = _unpack("<fi", rest)
    return name, value, kind


def _text(text: str) -> bytes:
    data = text.encode("ascii", "replace")
    return struct.pack("<i", len(data)) + data


def _read_text(data: bytes) -> tuple[str, bytes]:
    (length,) = _unpack("<i", data[:4])
    end = 4 + length
    if not 4 <= end <= len(data):
        raise _damaged()
    return data[4:end].decode("ascii", "replace"), data[end:]


def _unpack(form: str, data: bytes) -> tuple[Any, ...]:
    try:
        return struct.unpack(form, data)
    except struct.error as error:
        raise _damaged() from error


def _damaged() -> CommunicatorError:
    return CommunicatorError("the message has a side channel that is cut or damaged; update the other program")
