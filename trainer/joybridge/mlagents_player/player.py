"""The player: answers every step of a trainer of ML-Agents by a step of a session.

It does no input and output of its own: `answer` turns a TrainerStep into a FromPlayer.
"""

import sys
from collections.abc import Iterator, Mapping
from itertools import chain
from operator import attrgetter

import numpy as np
from google.protobuf.message import DecodeError

from joybridge.client.client import Session
from joybridge.config.errors import ConfigError
from joybridge.contract.codec import ActArrays, StepArrays, lane_count
from joybridge.contract.spec import choose_parameters
from joybridge.contract.tensors import Array
from joybridge.layouts import make_acts
from joybridge.mlagents import communicator_pb2 as ml
from joybridge.mlagents import side_channels
from joybridge.mlagents.records import FLOAT
from joybridge.mlagents.side_channels import Payload
from joybridge.mlagents.wire import MAX_MESSAGE_BYTES, CommunicatorError
from joybridge.mlagents_player.records import AgentRecords, scale_axes
from joybridge.policy.encoder import ObservationEncoder
from joybridge.v1 import bridge_pb2 as pb

IDS = 2**31  # an agent's id is an int32


class Player:
    """Plays the session for a trainer. An agent of ML-Agents is one episode of a lane."""

    def __init__(self, session: Session, seed: int, *, statistics: bool = True) -> None:
        """Take a session that has not been stepped. Raises ConfigError if its steps are too large for the trainer.

        statistics: send the metrics of episodes.
        """
        self.session, self.seed, self._statistics = session, seed, statistics
        self.fresh = True  # the session's first episodes have not begun
        self.behaviors = [Behavior(behavior, session.arenas) for behavior in session.spec.behaviors]
        each = max(1, largest_message(self.behaviors, statistics=statistics) // session.arenas)
        if each * session.arenas > MAX_MESSAGE_BYTES:
            raise ConfigError(
                f"a step of {session.arenas} arenas may have {each * session.arenas} bytes, and a trainer of ML-Agents "
                f"takes at most {MAX_MESSAGE_BYTES}; use at most {MAX_MESSAGE_BYTES // each} arenas"
            )

    def answer(self, step: ml.TrainerStep) -> ml.FromPlayer:
        """Return what happens after the actions of a step, or after a reset.

        New environment parameters are set at once, which ends all episodes: where no reset was asked for, as
        interrupted ones. Raises CommunicatorError, SpecError and SimulatorError.
        """
        parameters = self._parameters(step.side_channels)
        answer = ml.FromPlayer()
        statistics: list[Payload] = []
        if step.command == ml.RESET or self.fresh:
            steps = self._begin(parameters)
        else:
            pairs = zip(self.behaviors, self.session.steps, strict=True)
            acts = [behavior.act(step.actions.get(behavior.name, b""), last) for behavior, last in pairs]
            steps = self.session.step(acts)
            for behavior, after in zip(self.behaviors, steps, strict=True):
                behavior.end(after, answer, cut=bool(parameters))
                statistics += behavior.statistics(after) if self._statistics else ()
            if parameters:
                steps = self._begin(parameters)
        for behavior, after in zip(self.behaviors, steps, strict=True):
            behavior.ask(after, answer)
        answer.step.side_channels = side_channels.join(statistics)
        return answer

    def _parameters(self, data: bytes) -> dict[str, float]:
        """Return the parameters of the game that side channels set; all other channels are read by no game."""
        payloads = side_channels.split(data)
        given = dict(
            side_channels.read_parameter(one.data) for one in payloads if one.channel == side_channels.PARAMETERS
        )
        return choose_parameters(self.session.spec.parameters, given, self.session.spec.name)

    def _begin(self, parameters: Mapping[str, float]) -> list[StepArrays]:
        """Begin new episodes in all arenas. Those of a session that has not been played are new already."""
        steps = self.session.steps
        if not self.fresh or parameters:
            steps = self.session.reset(self.seed if self.fresh else None, parameters)
        for behavior in self.behaviors:
            behavior.renew(np.arange(len(behavior.ids)))
        self.fresh = False
        return steps


class Behavior:
    """One behavior of the game: its agents, as rows of arrays and as messages."""

    def __init__(self, spec: pb.Behavior, arenas: int) -> None:
        """Number the agents."""
        self.name, self.lanes = spec.name, lane_count(spec, arenas)
        self.records, self.masked_records = AgentRecords(spec), AgentRecords(spec, masked=True)
        self.announcement: ml.BehaviorParameters | None = _parameters(spec)  # until it has been sent
        self.ids = np.zeros(self.lanes, np.int64)  # of each lane's present episode
        self.next_id = 0
        self.asked = np.arange(0)  # the lanes that were asked for a decision, in the order of the message
        self._reward = ObservationEncoder(spec.name, spec, None, {}).rewards
        self._rest = make_acts(pb.GameSpec(behaviors=[spec]), arenas)[0]
        self._low, self._high = (
            np.array([getattr(axis, end) for axis in spec.device.axes], np.float32) for end in ("low", "high")
        )
        self._counts = np.array([len(branch.choices) for branch in spec.device.branches], np.int64)
        self._metrics = [f"{spec.name}/{metric.name}" for metric in spec.metrics]
        self._told = False  # that a forbidden choice was replaced

    def renew(self, lanes: Array) -> None:
        """Give lanes whose episodes begin new ids."""
        self.ids[lanes] = (self.next_id + np.arange(len(lanes))) % IDS
        self.next_id = (self.next_id + len(lanes)) % IDS

    def end(self, step: StepArrays, answer: ml.FromPlayer, *, cut: bool) -> None:
        """Add the agents whose episodes have ended. cut: all others end here as well, interrupted."""
        rewards = self._reward(step)
        if len(step.ended):
            self._add(
                answer,
                self.records.pack(
                    step.final_observations or [],
                    rewards[step.ended],
                    self.ids[step.ended],
                    interrupted=step.truncated[step.ended],
                ),
            )
        if cut and len(going := np.flatnonzero(~step.ends)):
            seen = [sensor[going] for sensor in step.observations]
            yes = np.ones(len(going), bool)
            self._add(answer, self.records.pack(seen, rewards[going], self.ids[going], interrupted=yes))
        self.renew(step.ended)

    def ask(self, step: StepArrays, answer: ml.FromPlayer) -> None:
        """Add the agents that decide next, and announce the behavior with its first ones."""
        observations, masks, rewards, ids = step.observations, step.masks, self._reward(step), self.ids
        rewards[step.ended] = 0.0  # those of this step belong to the episodes that have ended
        self.asked = np.arange(self.lanes)
        if step.deciding is not None and not step.deciding.all():
            self.asked = asked = np.flatnonzero(step.deciding)
            observations, rewards, ids = [sensor[asked] for sensor in observations], rewards[asked], ids[asked]
            masks = masks and [mask[asked] for mask in masks]
        if len(self.asked):
            records = self.records if masks is None else self.masked_records
            self._add(answer, records.pack(observations, rewards, ids, masks))

    def act(self, data: bytes, last: StepArrays) -> ActArrays:
        """Return the actions in an ActionList for the agents that were asked. Raises CommunicatorError.

        Axes of ML-Agents lie in -1..1. A choice that its mask forbids becomes the first allowed one, because a trainer
        sends 0 for an agent without an action.
        """
        if not len(self.asked):
            return self._rest
        try:
            actions = ml.ActionList.FromString(data).actions
            axes = np.frombuffer(b"".join(map(attrgetter("continuous"), actions)), FLOAT)
        except (DecodeError, ValueError) as error:
            raise CommunicatorError(f"{self.name}: the trainer sent no list of actions; update it") from error
        choices = np.fromiter(chain.from_iterable(map(attrgetter("discrete"), actions)), np.int64)
        agents, came = len(self.asked), (len(actions), len(axes), len(choices))
        wanted = (agents, agents * len(self._low), agents * len(self._counts))
        if came != wanted:
            raise CommunicatorError(
                f"{self.name}: the trainer sent {came[0]} actions with {came[1]} continuous and {came[2]} discrete "
                f"values together, expected {wanted[0]} with {wanted[1]} and {wanted[2]}: one per agent that asked"
            )
        act = ActArrays(self._rest.axes.copy(), self._rest.choices.copy())
        act.axes[self.asked] = scale_axes(axes.reshape(agents, -1), self._low, self._high)
        act.choices[self.asked] = self._allowed(choices.reshape(agents, -1), last)
        return act

    def statistics(self, step: StepArrays) -> Iterator[Payload]:
        """Yield the metrics of the episodes that have ended."""
        for row in () if step.metrics is None else step.metrics.tolist():
            for name, value in zip(self._metrics, row, strict=True):
                yield side_channels.statistic(name, value)

    @property
    def statistics_bytes(self) -> int:
        """The bytes of the metrics of one episode."""
        return len(side_channels.join(side_channels.statistic(name, 0.0) for name in self._metrics))

    def _add(self, answer: ml.FromPlayer, agents: bytes) -> None:
        answer.step.agents[self.name] += agents  # lists of messages side by side are one list
        if self.announcement is not None:
            answer.hello.behaviors.append(self.announcement)
            self.announcement = None

    def _allowed(self, choices: Array, last: StepArrays) -> Array:
        if not ((choices >= 0) & (choices < self._counts)).all():
            raise CommunicatorError(
                f"{self.name}: the trainer sent the choices {choices.min(0).tolist()} to {choices.max(0).tolist()}, "
                f"expected one below {self._counts.tolist()} for each branch"
            )
        for column, mask in enumerate(last.masks or ()):
            allowed = mask[self.asked]
            forbidden = ~allowed[np.arange(len(allowed)), choices[:, column]]
            if forbidden.any():
                choices[forbidden, column] = allowed[forbidden].argmax(axis=1)
                if not self._told:
                    print(
                        f"{self.name}: the trainer sends choices that are masked; each becomes the first allowed one",
                        file=sys.stderr,
                    )
                    self._told = True
        return choices


def largest_message(behaviors: list[Behavior], *, statistics: bool) -> int:
    """Return the bytes of a step in which all agents end an episode and begin one. statistics: with their metrics."""
    return sum(
        behavior.lanes * (2 * behavior.masked_records.dtype.itemsize + statistics * behavior.statistics_bytes)
        for behavior in behaviors
    )


def _parameters(behavior: pb.Behavior) -> ml.BehaviorParameters:
    sizes = [len(branch.choices) for branch in behavior.device.branches]
    return ml.BehaviorParameters(
        name=behavior.name,
        action_spec=ml.ActionSpec(
            continuous_actions=len(behavior.device.axes), discrete_actions=len(sizes), branch_sizes=sizes
        ),
    )
