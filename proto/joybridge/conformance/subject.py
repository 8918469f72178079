"""What the checks try: one game of a server, and what was seen while playing it with random legal actions."""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import grpc
import numpy as np

from joybridge.conformance.reading import Part, parts_of
from joybridge.conformance.registry import Broken, DoesNotApply, expect
from joybridge.conformance.wire import OK, Ended, Played, Request, Server, Stream
from joybridge.contract.codec import ActArrays, pack_act
from joybridge.contract.tensors import Array
from joybridge.v1 import bridge_pb2 as pb

INVALID, EARLY = grpc.StatusCode.INVALID_ARGUMENT, grpc.StatusCode.FAILED_PRECONDITION
NOT_FOUND, EXHAUSTED = grpc.StatusCode.NOT_FOUND, grpc.StatusCode.RESOURCE_EXHAUSTED

ARENAS = 2  # of an ordinary session
SEED = 1
LARGEST_SEED = 2**64 - 1
FEW = 12  # decisions of a short play
MANY = 2100  # of a long one, unless the game cuts its episodes sooner
LONG_SECONDS = 6.0  # a slow game is played for no longer; what was seen until then is judged

SAVE = pb.PlayRequest(save=pb.Save())


def act_request(act: pb.Act) -> pb.PlayRequest:
    """Return the request with some actions."""
    return pb.PlayRequest(act=act)


def reset_request(seed: int | None = None, parameters: Mapping[str, float] | None = None) -> pb.PlayRequest:
    """Return a request to begin new episodes."""
    return pb.PlayRequest(reset=pb.Reset(seed=seed, parameters=parameters or {}))


def record(step: pb.Step) -> bytes:
    """Return the bytes of a step, the clock on the wall left out."""
    return pb.Step(behaviors=step.behaviors, pictures=step.pictures).SerializeToString(deterministic=True)


def legal_act(parts: Sequence[Part], spec: pb.GameSpec, randoms: Sequence[np.random.Generator]) -> pb.Act:
    """Return random actions that the masks allow; those of an arena depend on its own generator alone."""
    acts = []
    for part in parts:
        device, agents = part.behavior.device, part.behavior.agents_per_arena
        axes, branches = len(device.axes), len(device.branches)
        chance = np.concatenate([random.random((agents, axes + branches)) for random in randoms])
        low, high = (np.array([getattr(axis, end) for axis in device.axes]) for end in ("low", "high"))
        values = np.clip(low + chance[:, :axes] * (high - low), low, high).astype(np.float32)
        choices = np.empty((part.lanes, branches), np.int32)
        for index in range(branches):
            allowed = part.allowed(index)
            wanted = np.floor(chance[:, axes + index] * allowed.sum(axis=1)) + 1  # the n-th of those allowed
            choices[:, index] = np.argmax(np.cumsum(allowed, axis=1) == wanted[:, None], axis=1)
        acts.append(pack_act(ActArrays(values, choices)))
    return pb.Act(behaviors=acts)


@dataclass
class Recording:
    """A session that was played with legal actions: requests[i] was answered with steps[i]."""

    spec: pb.GameSpec
    arenas: int
    requests: list[pb.PlayRequest] = field(default_factory=list)
    steps: list[pb.Step] = field(default_factory=list)
    started: pb.Started | None = None
    end: Ended | None = None  # how the server ended it, where it did
    snapshot: pb.Snapshot | None = None

    def parts(self, index: int) -> list[Part]:
        """Return the parts of one step."""
        return parts_of(self.steps[index], self.spec, self.arenas, index)

    @cached_property
    def first(self) -> list[Part]:
        """Return the parts of the first step."""
        return self.parts(0) if self.steps else []

    @cached_property
    def later(self) -> list[Part]:
        """Return the parts of all other steps."""
        return [part for index in range(1, len(self.steps)) for part in self.parts(index)]

    @property
    def records(self) -> list[bytes]:
        """Return the bytes of the steps."""
        return [record(step) for step in self.steps]


class Subject:
    """A server and, for all but the checks of the server as a whole, one of its games."""

    def __init__(self, server: Server, game: str) -> None:
        """Prepare to check a game; the empty name stands for the server as a whole."""
        self.server = server
        self.game = game

    @cached_property
    def spec(self) -> pb.GameSpec:
        """Return the spec under the default options. Raises Broken if there is none."""
        return self.server.describe(self.game)

    @cached_property
    def brief(self) -> Recording:
        """Return a short play. Raises Broken if the server does not even start it."""
        recording = self.record()
        expect(recording.steps, f"{recording.end} in answer to a start", "a session")
        return recording

    @cached_property
    def long(self) -> Recording:
        """Return a play of a whole episode and one decision more, where the game says how long they are.

        Raises Broken if the server plays nothing of it.
        """
        longest = self.spec.max_episode_decisions
        recording = self.record(decisions=min(longest, MANY) + 1 if longest else MANY // 4)
        expect(len(recording.steps) > 1, f"{recording.end} before any step", "a session that can be played")
        return recording

    def start(self, arenas: int = ARENAS, seed: int = SEED, **fields: Any) -> pb.PlayRequest:
        """Return the request that starts this game."""
        return pb.PlayRequest(start=pb.Start(game=self.game, arenas=arenas, seed=seed, **fields))

    def record(
        self, decisions: int = FEW, arenas: int = ARENAS, first_arena: int = 0, server: Server | None = None,
        resets: Mapping[int, pb.PlayRequest] | None = None, **fields: Any,
    ) -> Recording:  # fmt: skip
        """Play a session with random legal actions, those of an arena depending on its number alone.

        resets: requests to be sent instead of an act, by the decision; the actions, too, begin anew there.
        """
        with Stream(server or self.server) as stream:
            start = self.start(arenas, first_arena=first_arena, **fields)
            player = Player(stream, Recording(self.spec, arenas), start, first_arena)
            until = time.monotonic() + LONG_SECONDS
            for decision in range(decisions):
                if player.recording.end or time.monotonic() > until:
                    break
                if resets and decision in resets:
                    player.begin(resets[decision])
                else:
                    player.decide()
            return player.recording

    def play(self, *requests: Request) -> Played:
        """Send all requests of a stream at once and return what came of it."""
        return self.server.play(requests)

    def answered(self, *requests: Request) -> list[pb.PlayResponse]:
        """Return the responses to requests that must be answered. Raises Broken."""
        played = self.play(*requests)
        came = f"{len(played.responses)} responses to {len(requests)} requests, and then {played.end}"
        expect(len(played.responses) == len(requests) and played.end.code == OK.code, came, "a response to each")
        return played.responses

    def refused(self, *requests: Request, codes: Sequence[grpc.StatusCode] = (INVALID,), words: Sequence[str]) -> None:
        """Raise Broken unless the last of some requests is refused with one of some codes, naming one of some words."""
        played = self.play(*requests)
        before = len(requests) - 1
        if len(played.responses) < before:
            raise Broken(f"{played.end} in answer to request {len(played.responses) + 1}", "a response to it")
        wanted = " or ".join(code.name for code in codes)
        expect(len(played.responses) == before, "the request was answered", f"a refusal with {wanted}")
        expect_refusal(played.end, codes, words)

    def acting(self, behavior: int) -> tuple[list[pb.PlayRequest], pb.Act, int]:
        """Return requests after which some lane of a behavior decides, legal actions for it, and that lane."""
        recording = self.brief
        for index in range(len(recording.requests) - 1):
            for part in recording.parts(index)[behavior : behavior + 1]:
                if part.deciding.any() and recording.requests[index + 1].HasField("act"):
                    act = pb.Act()
                    act.CopyFrom(recording.requests[index + 1].act)
                    return recording.requests[: index + 1], act, int(np.argmax(part.deciding))
        name = self.spec.behaviors[behavior].name
        raise DoesNotApply(f"no lane of {name} decides in the first {FEW} decisions")

    @cached_property
    def is_random(self) -> bool:
        """Return whether arenas differ from each other, and so draw from the seed."""
        recording = self.record(arenas=4)
        return any(len({bytes(row) for row in _lanes(part)}) > 1 for part in [*recording.first, *recording.later])


class Player:
    """Goes on with a stream, keeping what was sent and what came."""

    def __init__(self, stream: Stream, recording: Recording, start: pb.PlayRequest, first_arena: int = 0) -> None:
        """Start a session."""
        self.stream, self.recording, self.first_arena = stream, recording, first_arena
        self.begin(start)

    def begin(self, request: pb.PlayRequest) -> None:
        """Send a start or a reset, after which the actions, too, begin anew."""
        numbers = range(self.first_arena, self.first_arena + self.recording.arenas)
        self.randoms = [np.random.default_rng([7, number]) for number in numbers]
        self.send(request)

    def decide(self) -> None:
        """Play one decision."""
        recording = self.recording
        if recording.steps:
            parts = recording.parts(len(recording.steps) - 1)
            self.send(act_request(legal_act(parts, recording.spec, self.randoms)))

    def save(self) -> None:
        """Ask for a snapshot and keep it."""
        answer = self.stream.ask(SAVE)
        if isinstance(answer, Ended) or not answer.HasField("snapshot"):
            came = answer if isinstance(answer, Ended) else answer.WhichOneof("response")
            raise Broken(f"{came} in answer to a save", "a snapshot")
        self.recording.snapshot = answer.snapshot

    def send(self, request: pb.PlayRequest) -> None:
        """Send a request and keep the step with which it is answered."""
        recording = self.recording
        if recording.end:
            return
        answer = self.stream.ask(request)
        if isinstance(answer, Ended):
            recording.end = answer
            return
        if answer.HasField("started"):
            recording.started = answer.started
        recording.requests.append(request)
        recording.steps.append(answer.started.step if answer.HasField("started") else answer.step)


def expect_refusal(end: Ended, codes: Sequence[grpc.StatusCode], words: Sequence[str]) -> None:
    """Raise Broken unless a call ended with one of some codes, its sentence naming one of some words."""
    wanted = " or ".join(code.name for code in codes)
    naming = " or ".join(map(repr, words))
    expected = f"{wanted} with a sentence that names {naming}" if words else f"{wanted} with a sentence"
    named = any(word.lower() in end.details.lower() for word in words) if words else end.details
    expect(end.code in codes and named, end, expected)


def expect_same(came: Recording, expected: Recording, what: str) -> None:
    """Raise Broken unless two plays gave the same bytes."""
    expect_same_bytes(came.records, expected.records, what)


def expect_same_bytes(came: Sequence[bytes], expected: Sequence[bytes], what: str) -> None:
    """Raise Broken unless two lists of steps are the same."""
    for index, (one, other) in enumerate(zip(came, expected, strict=False)):
        expect(one == other, f"{what}: other bytes in step {index}", "the same bytes")
    expect(len(came) == len(expected), f"{what}: {len(came)} steps", f"{len(expected)} steps")


def _lanes(part: Part) -> list[Array]:
    """Return one row of bytes per arena of what a part senses."""
    columns = [np.ascontiguousarray(values).view(np.uint8).reshape(part.arenas, -1) for _, values in part.sensed()]
    return list(np.concatenate(columns, axis=1)) if columns else []
