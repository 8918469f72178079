"""Lists of messages of the same length as NumPy records: constant bytes between columns.

The messages of an AgentList or ActionList differ only in some columns, so they are written and read without a loop.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

FLOAT = np.dtype("<f4")

Part = bytes | tuple[str, Any]  # what is the same for all messages, or a column: its name and its dtype


def packed(tag: int, numbers: Sequence[int]) -> bytes:
    """Return a field with a packed list of numbers that are not negative."""
    data = b"".join(map(varint, numbers))
    return bytes([tag]) + varint(len(data)) + data


def varint(number: int) -> bytes:
    """Return a number that is not negative as a varint."""
    data = bytearray()
    while number > 0x7F:
        data.append(number & 0x7F | 0x80)
        number >>= 7
    return bytes([*data, number])


def length(parts: Sequence[Part]) -> int:
    """Return the number of bytes of parts."""
    return sum(len(part) if isinstance(part, bytes) else np.dtype(part[1]).itemsize for part in parts)


def layout(parts: Sequence[Part]) -> tuple[Any, bytes]:
    """Return the dtype of a record of these parts, and its bytes with zeros in all columns."""
    names, formats, offsets, offset = [], [], [], 0
    for part in parts:
        if not isinstance(part, bytes):
            names.append(part[0])
            formats.append(np.dtype(part[1]))
            offsets.append(offset)
        offset += length([part])
    dtype: Any = np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": offset})
    return dtype, b"".join(part if isinstance(part, bytes) else bytes(length([part])) for part in parts)
