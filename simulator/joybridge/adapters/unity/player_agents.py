"""The agents of one player as lanes of a session."""

import logging
from collections.abc import Mapping, Sequence
from math import isfinite
from typing import NamedTuple

import numpy as np
from google.protobuf.message import DecodeError

from joybridge.adapters.unity.actions import ActionRecords
from joybridge.adapters.unity.forms import BehaviorForm
from joybridge.adapters.unity.lanes import Lanes
from joybridge.adapters.unity.player import UnityPlayer
from joybridge.adapters.unity.reader import AgentReader
from joybridge.adapters.unity.slots import Slots
from joybridge.adapters.unity.statistics import Metrics
from joybridge.contract.codec import ActArrays
from joybridge.contract.tensors import Array
from joybridge.contract.text import printable
from joybridge.mlagents import communicator_pb2 as ml
from joybridge.mlagents import side_channels
from joybridge.mlagents.wire import CommunicatorError

log = logging.getLogger("simulator")


class Asked(NamedTuple):
    """The agents that wait for an action, in the order of the message."""

    lanes: Array  # -1: an agent without a lane
    first: Array  # int32 [agents, branches]: the first allowed choice of each branch


class Part:
    """One behavior of one player."""

    def __init__(self, form: BehaviorForm, areas: int, first_lane: int) -> None:
        """first_lane: of the player's first agent; below 0 if this agent belongs to no arena of the session."""
        self.form, self.first_lane = form, first_lane
        self.reader, self.slots = AgentReader(form), Slots(areas * form.agents)
        self.records = ActionRecords(form.actions)
        self.metrics = Metrics(list(form.metrics.values()))
        self.ids = np.zeros(0, np.int64)  # of the agents that asked last, in the order of the message
        self.same = False  # whether all of them have lanes, so that they have the same lanes if they ask again
        self.everyone = np.zeros(0, bool)  # True for each of them
        self.asked = Asked(np.zeros(0, np.int64), np.zeros((0, len(form.sizes)), np.int32))

    def lanes_of(self, ids: list[int], count: int) -> Array:
        """Return the lane of each agent, -1 for those that have none among `count` lanes."""
        places = np.array(self.slots.find(ids), np.int64)
        lanes = places + self.first_lane
        return np.where((places >= 0) & (lanes >= 0) & (lanes < count), lanes, -1)


class PlayerAgents:
    """The agents of one player. An agent that finds no free lane is given zeros, as ML-Agents does without a policy."""

    def __init__(self, player: UnityPlayer, forms: Sequence[BehaviorForm], areas: int, first_arena: int) -> None:
        """first_arena: of the player, as the number of an arena of the session; may be below 0."""
        self.player = player
        self._parts = {form.name: Part(form, areas, first_arena * form.agents) for form in forms}
        self._others: dict[str, bytes] = {}  # actions of agents of other behaviors
        self._told: set[str] = set()

    def begin(self, step: ml.PlayerStep, session: Mapping[str, Lanes]) -> None:
        """Take what follows a reset: all episodes are new, and what has ended before is dropped."""
        for part in self._parts.values():
            part.slots.clear()
            part.same = False
        self.take(step, session, reset=True)

    def take(self, step: ml.PlayerStep, session: Mapping[str, Lanes], *, reset: bool = False) -> None:
        """Take what happened in the player. Raises GameError for what does not fit the spec."""
        statistics = self._statistics(step.side_channels)
        for name, part in self._parts.items():
            part.metrics.add(statistics)
            self._take(part, step.agents.get(name, b""), session[name], reset)
        self._others = {name: self._rest(name, data) for name, data in step.agents.items() if name not in self._parts}

    def actions(self, acts: Mapping[str, ActArrays]) -> ml.TrainerStep:
        """Return the actions of all agents that asked."""
        step = ml.TrainerStep(command=ml.STEP)
        for name, part in self._parts.items():
            lanes, choices = part.asked.lanes, part.asked.first.copy()
            if len(lanes):
                mine, act = lanes >= 0, acts[name]
                axes = np.where(mine[:, None], act.axes[lanes], np.float32(0))
                for column, branch in enumerate(part.form.branches):
                    choices[mine, branch] = act.choices[lanes[mine], column]
                step.actions[name] = part.records.pack(axes, choices)
        for name, data in self._others.items():
            step.actions[name] = data
        return step

    def _take(self, part: Part, data: bytes, lanes: Lanes, reset: bool) -> None:
        agents = part.reader.read(data)
        done = np.flatnonzero(agents.done)
        if len(done) and not reset:
            ended = agents.rows(done)
            ids = ended.ids.tolist()
            self._check_once(part, ids, "end")
            mine = part.lanes_of(ids, lanes.count)
            part.slots.end(ids)
            metrics = part.metrics.take(len(done))
            if len(found := np.flatnonzero(mine >= 0)):
                lanes.end(mine[found], ended.rows(found), metrics[found])
        asking = agents.rows(np.flatnonzero(~agents.done)) if len(done) else agents
        if not len(done) and part.same and np.array_equal(asking.ids, part.ids):
            lanes.ask(part.asked.lanes, asking, part.everyone)
            part.asked = Asked(part.asked.lanes, part.reader.first_allowed(asking))
            return
        ids = asking.ids.tolist()
        self._check_once(part, ids, "ask")
        known = part.lanes_of(ids, lanes.count) >= 0
        part.slots.begin(ids)
        mine = part.lanes_of(ids, lanes.count)
        found = np.flatnonzero(mine >= 0)
        part.ids, part.same, part.everyone = asking.ids, len(found) == len(ids), np.ones(len(ids), bool)
        if part.same:
            lanes.ask(mine, asking, known)
        else:
            lanes.ask(mine[found], asking.rows(found), known[found])
            if min(part.slots.find(ids)) < 0:
                self._tell(
                    f"the player at port {self.player.communicator.port} has more than {part.slots.count} agents of "
                    f"{part.form.name!r}; those without a lane are given zeros: serve it with "
                    f"agents={part.form.name}:N for N agents per arena"
                )
        part.asked = Asked(mine, part.reader.first_allowed(asking))

    def _check_once(self, part: Part, ids: list[int], what: str) -> None:
        """Raise GameError if an agent ends or asks twice."""
        if len(set(ids)) != len(ids):
            raise self.player.communicator.fault(f"lets an agent of {part.form.name!r} {what} twice in one message")

    def _rest(self, name: str, data: bytes) -> bytes:
        """Return actions for agents of a behavior that is not in the spec. Raises GameError."""
        self._tell(
            f"the player at port {self.player.communicator.port} has agents of {name!r}, which are given zeros: they "
            f"were not there when it was looked at; serve it with agents={name}:N for N agents per arena"
        )
        try:
            asking = sum(not agent.done for agent in ml.AgentList.FromString(data).agents)
        except DecodeError as error:
            raise self.player.communicator.fault("sent a damaged list of agents") from error
        parameters = self.player.announced.get(name)
        return ActionRecords(parameters.action_spec).rest(asking) if parameters else b""

    def _statistics(self, data: bytes) -> dict[str, tuple[list[float], int]]:
        found: dict[str, tuple[list[float], int]] = {}
        try:
            for payload in side_channels.split(data):
                if payload.channel == side_channels.STATISTICS:
                    name, value, kind = side_channels.read_statistic(payload.data)
                    values, _ = found.get(name, ([], kind))
                    found[name] = ([*values, value], kind)
        except CommunicatorError as error:
            raise self.player.communicator.fault(f"is not understood: {error}") from error
        wanted = {key for part in self._parts.values() for key in part.form.metrics.values()}
        for name, (values, _) in found.items():
            if name not in wanted:
                self._tell(f"the statistic {name!r} of the player is not reported; serve it with metrics={name}")
            elif not all(map(isfinite, values)):
                raise self.player.communicator.fault(f"sent a value of the statistic {name!r} that is not finite")
        return found

    def _tell(self, text: str) -> None:
        if text not in self._told and len(self._told) < 100:
            self._told.add(text)
            log.warning("%s", printable(text))
