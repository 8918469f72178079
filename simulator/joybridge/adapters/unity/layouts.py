"""Which bytes of an agent's message vary, so that many such messages are read as arrays."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from joybridge.adapters.unity.agents import Agents
from joybridge.adapters.unity.forms import BehaviorForm
from joybridge.contract.tensors import Array

REWARD, DONE, INTERRUPTED, ID, MASK, OBSERVATION, GROUP_REWARD = 7, 8, 9, 10, 11, 13, 15  # fields of Agent
FLOATS, DATA = 4, 1  # fields of Observation and of Floats
VARINT, FIXED64, BYTES, FIXED32 = 0, 1, 2, 5  # wire types
WIRE_TYPES = {
    REWARD: FIXED32,
    DONE: VARINT,
    INTERRUPTED: VARINT,
    ID: VARINT,
    MASK: BYTES,
    OBSERVATION: BYTES,
    GROUP_REWARD: FIXED32,
}


class Field(NamedTuple):
    """One field of a message."""

    number: int
    wire_type: int
    begin: int  # of its value
    end: int


class AgentLayout:
    """Where the values of an agent are in a message of one length."""

    def __init__(self, data: bytes, columns: dict[str, Field]) -> None:
        """Take a message, and the fields that vary."""
        self._columns = columns
        fixed = np.ones(len(data), bool)
        for field in columns.values():
            fixed[field.begin : field.end] = False
        self._fixed = np.flatnonzero(fixed)
        self._template = np.frombuffer(data, np.uint8)[self._fixed]
        varints = [field for field in columns.values() if field.wire_type == VARINT]
        # The last byte of a varint is below 0x80, those before it are not.
        self._varint = np.concatenate([np.arange(one.begin, one.end) for one in varints] or [np.zeros(0, int)])
        self._more = np.concatenate(
            [np.arange(one.begin, one.end) < one.end - 1 for one in varints] or [np.zeros(0, bool)]
        )

    @staticmethod
    def of(data: bytes, form: BehaviorForm) -> "AgentLayout | None":
        """Return the layout of a message that protobuf has read; None if it cannot be read as arrays."""
        try:
            return AgentLayout._learn(data, form)
        except LookupError:  # it has what Joybridge does not know
            return None

    @staticmethod
    def _learn(data: bytes, form: BehaviorForm) -> "AgentLayout | None":
        columns: dict[str, Field] = {}
        observations = 0
        for field in _fields(data, 0, len(data)):
            name = str(field.number)
            if WIRE_TYPES.get(field.number, field.wire_type) != field.wire_type:
                return None
            if field.number == OBSERVATION:
                values = _floats(data, field)
                if values is None or observations == len(form.sensors) or form.sensors[observations].png:
                    return None
                name, field = f"observation {observations}", values
                observations += 1
            elif field.number not in WIRE_TYPES or (
                field.number == MASK and field.end - field.begin != sum(form.sizes)
            ):
                continue
            if name in columns:
                return None
            columns[name] = field
        return AgentLayout(data, columns) if observations == len(form.sensors) else None

    def fits(self, rows: Array) -> Array:
        """Return which messages have this layout, bool [agents]. rows: uint8 [agents, length]."""
        same = (rows[:, self._fixed] == self._template).all(axis=1)
        return same & ((rows[:, self._varint] >= 0x80) == self._more).all(axis=1)  # type: ignore[no-any-return]

    def read(self, rows: Array, index: Array | slice, agents: Agents) -> None:
        """Read messages of this layout. index: the numbers of the agents."""
        if not len(rows):
            return
        for name, field in self._columns.items():
            values = rows[:, field.begin : field.end]
            if name.startswith("observation"):
                column = agents.observations[int(name.split()[1])]
                column[index] = values.view("<f4").reshape(len(rows), *column.shape[1:])
            elif field.number == MASK:
                agents.allowed[index] = values == 0
            elif field.wire_type == FIXED32:
                agents.rewards[index, int(field.number == GROUP_REWARD)] = values.view("<f4")[:, 0]
            else:
                number = ((values & 0x7F).astype(np.int64) << 7 * np.arange(values.shape[1])).sum(axis=1)
                target = {ID: agents.ids, DONE: agents.done, INTERRUPTED: agents.interrupted}[field.number]
                target[index] = number.astype(np.int32) if field.number == ID else number != 0


def _floats(data: bytes, observation: Field) -> Field | None:
    """Return the field with the numbers of an observation, None if it has none or several."""
    found = [field for field in _fields(data, observation.begin, observation.end) if field.number == FLOATS]
    values = [field for one in found for field in _fields(data, one.begin, one.end)]
    return values[0] if len(values) == 1 and values[0].number == DATA else None


def _fields(data: bytes, begin: int, end: int) -> Iterator[Field]:
    """Yield the fields of a message that protobuf has read."""
    while begin < end:
        key, begin = _varint(data, begin)
        number, wire_type = key >> 3, key & 7
        stop = begin
        if wire_type == VARINT:
            _, stop = _varint(data, begin)
        elif wire_type == BYTES:
            size, begin = _varint(data, begin)
            stop = begin + size
        else:
            stop = begin + {FIXED32: 4, FIXED64: 8}[wire_type]
        yield Field(number, wire_type, begin, stop)
        begin = stop


def _varint(data: bytes, begin: int) -> tuple[int, int]:
    """Return a varint and where it ends."""
    number = shift = 0
    while True:
        byte = data[begin]
        begin += 1
        number |= (byte & 0x7F) << shift
        shift += 7
        if byte < 0x80:
            return number, begin
