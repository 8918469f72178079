"""Reads the agents of one behavior in a message of a player, as arrays.

Agents whose messages have the same fields of the same lengths are read together: which bytes vary is learned from the
first of them, which is read by protobuf. All others are read one by one; so are those with PNG.
"""

from collections import defaultdict
from collections.abc import Sequence
from itertools import pairwise
from math import isfinite

import numpy as np
from google.protobuf.message import DecodeError

from joybridge.adapters.unity.agents import Agents
from joybridge.adapters.unity.forms import BehaviorForm, SensorForm
from joybridge.adapters.unity.layouts import AgentLayout
from joybridge.adapters.unity.pictures import decode
from joybridge.contract.tensors import Array
from joybridge.mlagents import communicator_pb2 as ml
from joybridge.simulator.batched_game import GameError

MAX_LAYOUTS = 8  # of agents of the same length
MAX_SIZE_BYTES = 5  # of a size, as protobuf writes it
MAX_LENGTHS = 256  # of which layouts are remembered


class AgentReader:
    """Reads AgentLists of one behavior of one player."""

    def __init__(self, form: BehaviorForm) -> None:
        """Read agents of this form."""
        self.form = form
        self._choices = sum(form.sizes)
        self._bounds = list(pairwise(np.cumsum([0, *form.sizes]).tolist()))
        self._layouts: dict[int, list[AgentLayout]] = defaultdict(list)  # by length

    def read(self, data: bytes) -> Agents:
        """Return the agents in an AgentList. Raises GameError for what does not fit the form."""
        rows = _alike(data)
        if rows is not None:
            agents = self._empty(len(rows))
            self._read_alike(rows, slice(None), agents)
        else:
            spans = self._spans(data)
            agents = self._empty(len(spans))
            lengths = spans[:, 1] - spans[:, 0]
            for length in np.unique(lengths).tolist():
                index = np.flatnonzero(lengths == length)
                rows = np.frombuffer(data, np.uint8)[spans[index, 0][:, None] + np.arange(length)]
                self._read_alike(rows, index, agents)
        self._check(agents)
        for one, sensor in enumerate(self.form.sensors):
            if sensor.image and not sensor.png:
                agents.observations[one] = agents.observations[one].transpose(0, 2, 3, 1)
        return agents

    def first_allowed(self, agents: Agents) -> Array:
        """Return the first allowed choice of each branch, int32 [agents, branches]."""
        columns = [agents.allowed[:, begin:end].argmax(axis=1) for begin, end in self._bounds]
        return np.array(columns, np.int32).reshape(len(columns), len(agents.ids)).T

    def _empty(self, count: int) -> Agents:
        shapes = [(*one.shape[1:], one.shape[0]) if one.png else one.shape for one in self.form.sensors]
        return Agents(
            np.zeros(count, np.int64),
            np.zeros(count, bool),
            np.zeros(count, bool),
            np.zeros((count, 2), np.float32),
            np.ones((count, self._choices), bool),
            [np.empty((count, *shape), one.dtype) for shape, one in zip(shapes, self.form.sensors, strict=True)],
        )

    def _spans(self, data: bytes) -> Array:
        """Return where the message of each agent begins and ends, [agents, 2]."""
        spans, offset = [], 0
        try:
            while offset < len(data):
                begin, length = offset + 1, 0
                shift = 0
                for _ in range(MAX_SIZE_BYTES):
                    byte = data[begin]
                    begin += 1
                    length |= (byte & 0x7F) << shift
                    shift += 7
                    if byte < 0x80:
                        break
                else:
                    raise IndexError
                if data[offset] != 0x0A or begin + length > len(data):
                    raise IndexError
                spans.append((begin, begin + length))
                offset = begin + length
        except IndexError:
            raise self._wrong("the list of agents is damaged") from None
        return np.array(spans, np.int64).reshape(-1, 2)

    def _read_alike(self, rows: Array, index: Array | slice, agents: Agents) -> None:
        """Read agents of the same length. rows: uint8 [agents, length]; index: their numbers."""
        if len(self._layouts) >= MAX_LENGTHS:
            self._layouts.clear()
        layouts = self._layouts[rows.shape[1]]
        for layout in layouts:
            fits = layout.fits(rows)
            if fits.all():
                layout.read(rows, index, agents)
                return
            if isinstance(index, slice):
                index = np.arange(len(rows))
            layout.read(rows[fits], index[fits], agents)
            rows, index = rows[~fits], index[~fits]
        if isinstance(index, slice):
            index = np.arange(len(rows))
        while len(rows):
            self._read_one(rows[0].tobytes(), index[0], agents)
            learned = AgentLayout.of(rows[0].tobytes(), self.form)
            rows, index = rows[1:], index[1:]
            if learned is not None and len(layouts) < MAX_LAYOUTS:
                layouts.append(learned)
                self._read_alike(rows, index, agents)
                return

    def _read_one(self, data: bytes, row: int, agents: Agents) -> None:
        try:
            agent = ml.Agent.FromString(data)
        except DecodeError as error:
            raise self._wrong("an agent is no message of ML-Agents") from error
        agents.ids[row], agents.done[row], agents.interrupted[row] = agent.id, agent.done, agent.interrupted
        agents.rewards[row] = agent.reward, agent.group_reward
        if len(agent.action_mask) == self._choices:  # as in ML-Agents, others are not looked at
            agents.allowed[row] = np.frombuffer(agent.action_mask, np.uint8) == 0
        if len(agent.observations) != len(self.form.sensors):
            raise self._wrong(
                f"agent {agent.id} has {len(agent.observations)} observations, expected {len(self.form.sensors)}, "
                "as at first"
            )
        for sensor, observation, column in zip(self.form.sensors, agent.observations, agents.observations, strict=True):
            try:
                column[row] = _values(sensor, observation)
            except ValueError as error:
                raise GameError(f"{sensor.where} of agent {agent.id} {error}") from error

    def _check(self, agents: Agents) -> None:
        """Check the values. Raises GameError."""
        for where, values in (("a reward", agents.rewards), *self._floats(agents)):
            # A finite sum of squares means that all values are finite. It is faster than testing each value.
            if not isfinite(np.vdot(values, values)) and not np.isfinite(values).all():
                row = np.argwhere(~np.isfinite(values))[0][0]
                raise self._wrong(f"{where} of agent {agents.ids[row]} is not finite, expected finite numbers")
        for branch, (begin, end) in enumerate(self._bounds):
            if len(none := np.flatnonzero(~agents.allowed[:, begin:end].any(axis=1) & ~agents.done)):
                raise self._wrong(f"agent {agents.ids[none[0]]} allows no choice of branch {branch}, expected one")

    def _floats(self, agents: Agents) -> Sequence[tuple[str, Array]]:
        return [
            (f"observation {index}", column)
            for index, column in enumerate(agents.observations)
            if column.dtype != np.uint8
        ]

    def _wrong(self, text: str) -> GameError:
        return GameError(f"behavior {self.form.name!r}: {text}")


def _alike(data: bytes) -> Array | None:
    """Return the messages of a list in which all have the same length, uint8 [agents, length]; None for others."""
    if len(data) < 2:
        return None
    head = next((1 + size for size in range(1, MAX_SIZE_BYTES + 1) if data[size : size + 1] < b"\x80"), 0)
    if head == 0:
        return None
    whole = head + sum((byte & 0x7F) << 7 * index for index, byte in enumerate(data[1:head]))
    if len(data) % whole:
        return None
    rows = np.frombuffer(data, np.uint8).reshape(-1, whole)
    return rows[:, head:] if data[0] == 0x0A and (rows[:, :head] == rows[0, :head]).all() else None


def _values(sensor: SensorForm, observation: ml.Observation) -> Array:
    """Return one observation. Raises ValueError."""
    if tuple(observation.shape) != sensor.shape:
        raise ValueError(f"has shape {list(observation.shape)[:9]}, expected {list(sensor.shape)}, as at first")
    if sensor.png:
        if observation.compression != ml.PNG:
            raise ValueError("is no PNG, expected PNG, as at first")
        channels, height, width = sensor.shape
        return decode(observation.compressed, (channels, height, width), observation.channel_mapping)
    if sensor.image and observation.compression != ml.NONE:
        raise ValueError("is compressed, expected numbers, as at first")
    data = observation.floats.data
    count = int(np.prod(sensor.shape))
    if len(data) != 4 * count:
        raise ValueError(f"has {len(data)} bytes of numbers, expected {4 * count} for shape {list(sensor.shape)}")
    return np.frombuffer(data, "<f4").reshape(sensor.shape)
