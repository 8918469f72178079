"""Sessions played with valid random actions: the player, and the recording that the checks compare and inspect."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from joybridge.conformance.client import Status, Stream
from joybridge.conformance.expectations import Violation, expect
from joybridge.conformance.step_view import StepView, views_of
from joybridge.contract.codec import ActArrays, pack_act
from joybridge.v1 import bridge_pb2 as pb

SAVE = pb.PlayRequest(save=pb.Save())
Distributions = Mapping[str, pb.Distribution]


def act_request(act: pb.Act) -> pb.PlayRequest:
    """Return a request with an Act."""
    return pb.PlayRequest(act=act)


def reset_request(
    seed: int | None = None, parameters: Mapping[str, float] | None = None, distributions: Distributions | None = None
) -> pb.PlayRequest:
    """Return a request with a Reset."""
    reset = pb.Reset(seed=seed, parameters=parameters or {}, distributions=distributions or {})
    return pb.PlayRequest(reset=reset)


def step_bytes(step: pb.Step) -> bytes:
    """Return the bytes of a step that must be deterministic: all but simulate_seconds."""
    return pb.Step(behaviors=step.behaviors, pictures=step.pictures).SerializeToString(deterministic=True)


def valid_act(views: Sequence[StepView], generators: Sequence[np.random.Generator | None]) -> pb.Act:
    """Return valid actions. Those of an arena are random and depend on its own generator only.

    An arena without a generator idles: the middle of each axis, and the first allowed choice of each branch.
    """
    acts = []
    for view in views:
        device, agents = view.behavior.device, view.behavior.agents_per_arena
        axes, branches = len(device.axes), len(device.branches)
        idle = np.repeat([[0.5] * axes + [0.0] * branches], agents, axis=0)
        drawn = [generator.random(idle.shape) if generator else idle for generator in generators]
        chance = np.concatenate(drawn)
        low, high = (np.array([getattr(axis, end) for axis in device.axes]) for end in ("low", "high"))
        values = np.clip(low + chance[:, :axes] * (high - low), low, high).astype(np.float32)
        choices = np.empty((view.lanes, branches), np.int32)
        for index in range(branches):
            allowed = view.allowed(index)
            nth = np.floor(chance[:, axes + index] * allowed.sum(axis=1)) + 1  # of the allowed choices, from 1
            choices[:, index] = np.argmax(np.cumsum(allowed, axis=1) == nth[:, None], axis=1)
        acts.append(pack_act(ActArrays(values, choices)))
    return pb.Act(behaviors=acts)


@dataclass
class Recording:
    """A session: steps[i] is the response to requests[i]."""

    spec: pb.GameSpec
    arenas: int
    requests: list[pb.PlayRequest] = field(default_factory=list)
    steps: list[pb.Step] = field(default_factory=list)
    started: pb.Started | None = None
    end: Status | None = None  # the status, if the server ended the session
    snapshot: pb.Snapshot | None = None

    def views(self, index: int) -> list[StepView]:
        """Return the views of one step."""
        return views_of(self.steps[index], self.spec, self.arenas, index)

    @cached_property
    def first(self) -> list[StepView]:
        """Return the views of the first step."""
        return self.views(0) if self.steps else []

    @cached_property
    def later(self) -> list[StepView]:
        """Return the views of all steps after the first."""
        return [view for index in range(1, len(self.steps)) for view in self.views(index)]

    @property
    def step_bytes(self) -> list[bytes]:
        """Return the deterministic bytes of each step."""
        return [step_bytes(step) for step in self.steps]


class Player:
    """Plays a session with valid actions and records it."""

    def __init__(
        self, stream: Stream, recording: Recording, start: pb.PlayRequest, numbers: Sequence[int | None] | None = None
    ) -> None:
        """Start a session. `numbers` seed the actions, one per arena, by default 0, 1, …; with None an arena idles."""
        self.stream, self.recording = stream, recording
        self.numbers = range(recording.arenas) if numbers is None else numbers
        self.begin(start)

    def begin(self, request: pb.PlayRequest) -> None:
        """Send a Start or a Reset and seed the generators of the actions again."""
        self.generators = [None if number is None else np.random.default_rng([7, number]) for number in self.numbers]
        self.send(request)

    def decide(self, distributions: Distributions | None = None) -> None:
        """Play one decision, with new distributions of parameters in its Act."""
        recording = self.recording
        if recording.steps:
            act = valid_act(recording.views(len(recording.steps) - 1), self.generators)
            self.send(act_request(pb.Act(behaviors=act.behaviors, distributions=distributions or {})))

    def save(self) -> None:
        """Request a snapshot and keep it in the recording. Raises Violation if the response is no snapshot."""
        answer = self.stream.ask(SAVE)
        if isinstance(answer, Status) or not answer.HasField("snapshot"):
            got = answer if isinstance(answer, Status) else answer.WhichOneof("response")
            raise Violation(f"{got} in response to Save", "a Snapshot")
        self.recording.snapshot = answer.snapshot

    def send(self, request: pb.PlayRequest) -> None:
        """Send a request and record the step in its response. Does nothing after the end of the session."""
        recording = self.recording
        if recording.end:
            return
        answer = self.stream.ask(request)
        if isinstance(answer, Status):
            recording.end = answer
            return
        if answer.HasField("started"):
            recording.started = answer.started
        recording.requests.append(request)
        recording.steps.append(answer.started.step if answer.HasField("started") else answer.step)


def expect_same_recording(got: Recording, expected: Recording, when: str) -> None:
    """Raise Violation unless two recordings have the same bytes in each step, and the same end."""
    expect(got.end is None or expected.end is not None, f"{got.end} {when}", "the same steps as before")
    expect_same_bytes(got.step_bytes, expected.step_bytes, when)


def expect_same_bytes(got: Sequence[bytes], expected: Sequence[bytes], when: str) -> None:
    """Raise Violation unless two lists of steps have the same bytes."""
    for index, (one, other) in enumerate(zip(got, expected, strict=False)):
        expect(one == other, f"different bytes in step {index} {when}", "the same bytes")
    expect(len(got) == len(expected), f"{len(got)} steps {when}", f"{len(expected)} steps")
