"""The subject of a check: one game of a server, with recordings of it that several checks share."""

import math
import time
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any

import grpc
import numpy as np

from joybridge.conformance.client import OK, Client, Exchange, Request, Status, Stream
from joybridge.conformance.expectations import NotApplicable, Violation, expect
from joybridge.conformance.recording import Player, Recording
from joybridge.conformance.step_view import StepView
from joybridge.contract.tensors import Array
from joybridge.v1 import bridge_pb2 as pb

INVALID_ARGUMENT, FAILED_PRECONDITION = grpc.StatusCode.INVALID_ARGUMENT, grpc.StatusCode.FAILED_PRECONDITION
NOT_FOUND, RESOURCE_EXHAUSTED = grpc.StatusCode.NOT_FOUND, grpc.StatusCode.RESOURCE_EXHAUSTED

ARENAS = 2  # of a session, unless a check needs another number or the game has one arena only
SEED = 1
MAX_SEED = 2**64 - 1
CROWD = 8  # arenas whose episodes are compared: so many are hardly alike by chance, even if they differ by a coin
SHORT = 12  # decisions of a short session
LONG = 2100  # decisions of a long session, unless max_episode_decisions is smaller
LONG_SECONDS = 6.0  # a long session ends early after this time; the checks use the steps until then
LONG_NUMBERS = (0, 1, None, None)  # of the arenas of a long session; see Player: those that idle play the longest


class Subject:
    """A server and one of its games under some options. For checks of the whole server it is any game, "" for none."""

    def __init__(
        self, client: Client, game: str, options: Mapping[str, str] | None = None, decisions: int = LONG
    ) -> None:
        """Prepare to check a game. Nothing is sent yet. A long session has at most so many decisions."""
        self.client = client
        self.game = game
        self.options = dict(options or {})
        self.decisions = decisions

    @cached_property
    def spec(self) -> pb.GameSpec:
        """Return the spec under these options. Raises Violation if DescribeGame fails."""
        return self.client.describe(self.game, self.options)

    @cached_property
    def short_session(self) -> Recording:
        """Return a recording of SHORT decisions. Raises Violation if the session does not start."""
        recording = self.record()
        expect(recording.steps, f"{recording.end} in response to Start", "Started")
        return recording

    @cached_property
    def long_session(self) -> Recording:
        """Return a recording of a whole episode and one more decision, if the spec limits the length of episodes.

        Raises Violation if the server responds to no Act.
        """
        longest = self.spec.max_episode_decisions
        recording = self.record_long(min(longest or LONG // 4, self.decisions) + 1)
        expect(len(recording.steps) > 1, f"{recording.end} before the first Step", "a Step in response to Act")
        return recording

    def record_long(self, decisions: int, **fields: Any) -> Recording:
        """Return a recording of so many decisions, or of those that a slow server answers in LONG_SECONDS."""
        numbers = LONG_NUMBERS[: self.spec.max_arenas]
        return self.record(decisions, len(numbers), numbers=numbers, seconds=LONG_SECONDS, **fields)

    @cached_property
    def drawn_session(self) -> Recording:
        """Return a long session in which every parameter is drawn from its whole range at each episode."""
        longest = self.spec.max_episode_decisions
        return self.record_long(min(longest or LONG // 4, self.decisions) + 1, distributions=self.uniform())

    def uniform(self) -> dict[str, pb.Distribution]:
        """Return a distribution for each parameter: uniform over its whole range, or its only value."""
        return {
            p.name: pb.Distribution(uniform=pb.Interval(low=p.low, high=p.high)) if p.low < p.high else only(p.low)
            for p in self.spec.parameters
        }

    def other_parameters(self) -> dict[str, float]:
        """Return a value for each parameter: low or high, whichever is not its default."""
        return {p.name: p.low if p.default_value != p.low else p.high for p in self.spec.parameters}

    @property
    def arenas(self) -> int:
        """Return the number of arenas of a session, unless a check needs another one."""
        return min(ARENAS, max(self.spec.max_arenas, 1))

    def start(self, arenas: int | None = None, seed: int = SEED, **fields: Any) -> pb.PlayRequest:
        """Return a request that starts this game."""
        fields = {"options": self.options, **fields}
        arenas = self.arenas if arenas is None else arenas
        return pb.PlayRequest(start=pb.Start(game=self.game, arenas=arenas, seed=seed, **fields))

    def record(
        self,
        decisions: int = SHORT,
        arenas: int | None = None,
        resets: Mapping[int, pb.PlayRequest] | None = None,
        numbers: Sequence[int | None] | None = None,
        seconds: float = math.inf,
        **fields: Any,
    ) -> Recording:
        """Play a session with valid actions and return the recording.

        `numbers` seed the actions of the arenas (see Player), by default the numbers of the arenas. `resets` maps a
        decision to the request that is sent instead of its Act; the actions are seeded again there. After the first
        decision the recording ends early after `seconds`. `fields` are fields of Start.
        """
        arenas = self.arenas if arenas is None else arenas
        first = fields.get("first_arena", 0)
        with Stream(self.client) as stream:
            numbers = range(first, first + arenas) if numbers is None else numbers
            player = Player(stream, Recording(self.spec, arenas), self.start(arenas, **fields), numbers)
            until = time.monotonic() + seconds  # after Start, which may take long: games are compiled then
            for decision in range(decisions):
                if resets and decision in resets:
                    player.begin(resets[decision])
                else:
                    player.decide()
                if player.recording.end or time.monotonic() > until:
                    break
            return player.recording

    def record_reset(self, request: pb.PlayRequest, **fields: Any) -> Recording:
        """Return a recording of the step after a Reset in the middle of a session, and of SHORT decisions after it."""
        recording = self.record(2 * SHORT + 1, resets={SHORT: request}, **fields)
        recording.steps = recording.steps[SHORT + 1 :]
        return recording

    def player(self, stream: Stream, arenas: int | None = None, **fields: Any) -> Player:
        """Return what plays a session of this game on a stream. `fields` are fields of Start."""
        arenas = self.arenas if arenas is None else arenas
        return Player(stream, Recording(self.spec, arenas), self.start(arenas, **fields))

    def play(self, *requests: Request) -> Exchange:
        """Send all requests of a stream without waiting for responses."""
        return self.client.play(requests)

    def expect_answered(self, *requests: Request) -> list[pb.PlayResponse]:
        """Return one response per request. Raises Violation if there are fewer or the stream ends with an error."""
        exchange = self.play(*requests)
        got = f"{len(exchange.responses)} responses to {len(requests)} requests, then {exchange.status}"
        answered = len(exchange.responses) == len(requests) and exchange.status.code == OK.code
        expect(answered, got, "one response per request, then OK")
        return exchange.responses

    def expect_steps(self, requests: Sequence[pb.PlayRequest]) -> list[pb.Step]:
        """Return the steps that answer Start, Act and Reset. Raises Violation as `expect_answered` does."""
        return [
            response.started.step if response.HasField("started") else response.step
            for response in self.expect_answered(*requests)
        ]

    def expect_refused(
        self, *requests: Request, codes: Sequence[grpc.StatusCode] = (INVALID_ARGUMENT,), words: Sequence[str]
    ) -> None:
        """Raise Violation unless the last request is refused with one of `codes` and a text with one of `words`."""
        exchange = self.play(*requests)
        before = len(requests) - 1
        if len(exchange.responses) < before:
            raise Violation(f"{exchange.status} in response to request {len(exchange.responses) + 1}", "a response")
        expect(len(exchange.responses) == before, "a response to the invalid request", f"status {_names(codes)}")
        expect_error(exchange.status, codes, words)

    def expect_no_spec(
        self, game: str, options: Mapping[str, str], code: grpc.StatusCode, words: Sequence[str]
    ) -> None:
        """Raise Violation unless DescribeGame fails with `code` and a text with one of `words`."""
        answer = self.client.try_describe(game, options)
        expect(isinstance(answer, Status), f"a spec of {game!r} with {dict(options)}", code.name)
        assert isinstance(answer, Status)
        expect_error(answer, [code], words)

    def acting(self, behavior: int) -> tuple[list[pb.PlayRequest], pb.Act, int]:
        """Return requests after which a lane of a behavior decides, a valid Act to send next, and that lane.

        Raises NotApplicable if no lane of the behavior decides in the short session.
        """
        recording = self.short_session
        for index in range(len(recording.requests) - 1):
            for view in recording.views(index)[behavior : behavior + 1]:
                if view.deciding.any() and recording.requests[index + 1].HasField("act"):
                    act = pb.Act()
                    act.CopyFrom(recording.requests[index + 1].act)
                    return recording.requests[: index + 1], act, int(np.argmax(view.deciding))
        name = self.spec.behaviors[behavior].name
        raise NotApplicable(f"no lane of {name} decides in the first {SHORT} decisions")

    @cached_property
    def is_random(self) -> bool:
        """Return whether arenas of one session differ under the same actions: the game uses its seed."""
        arenas = min(4, self.spec.max_arenas)
        recording = self.record(arenas=arenas, numbers=[0] * arenas)
        views = [*recording.first, *recording.later]
        return any(len({bytes(row) for row in _arena_observations(view)}) > 1 for view in views)


def only(value: float) -> pb.Distribution:
    """Return the distribution of which every value is the same."""
    return pb.Distribution(choice=pb.Values(values=[value]))


def expect_error(status: Status, codes: Sequence[grpc.StatusCode], words: Sequence[str]) -> None:
    """Raise Violation unless a call ended with one of `codes` and a text that contains one of `words`."""
    about = f" that names {' or '.join(map(repr, words))}" if words else ""
    named = any(word.lower() in status.details.lower() for word in words) if words else status.details
    expect(status.code in codes and named, status, f"{_names(codes)} with a text{about}")


def _names(codes: Sequence[grpc.StatusCode]) -> str:
    return " or ".join(code.name for code in codes)


def _arena_observations(view: StepView) -> list[Array]:
    """Return one row of bytes per arena: the observations of all its lanes."""
    columns = [
        np.ascontiguousarray(values).view(np.uint8).reshape(view.arenas, -1) for _, values in view.observations()
    ]
    return list(np.concatenate(columns, axis=1)) if columns else []
