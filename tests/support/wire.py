"""The client's end of a Play stream without any help or check: it sends what it is told, right or wrong."""

from queue import SimpleQueue
from typing import Any

import grpc
import numpy as np
import pytest

from joybridge.contract.codec import ActArrays, Codec, StepArrays, fill_step, pack_act
from joybridge.v1 import bridge_pb2 as pb
from joybridge.v1 import bridge_pb2_grpc as rpc

PLAY = "/joybridge.v1.SimulatorService/Play"
SECONDS = 300.0  # no call may hang for ever; none comes near it, also on a busy machine
ANY_LENGTH = [("grpc.max_receive_message_length", -1), ("grpc.max_send_message_length", -1)]


def start(game, arenas=2, seed=1, **fields):
    return pb.PlayRequest(start=pb.Start(game=game, arenas=arenas, seed=seed, **fields))


def act(*behaviors, draw=()):
    return pb.PlayRequest(act=pb.Act(behaviors=behaviors, draw=draw))


def reset(**fields):
    return pb.PlayRequest(reset=pb.Reset(**fields))


def pack_step(step: StepArrays) -> pb.BehaviorStep:
    message = pb.BehaviorStep()
    fill_step(message, step)
    return message


SAVE = pb.PlayRequest(save=pb.Save())


class Stream:
    """One Play stream over a connection of its own. Requests are messages or their bytes."""

    def __init__(self, address, **call):
        self.channel = grpc.insecure_channel(address, ANY_LENGTH)
        self.requests: SimpleQueue[Any] = SimpleQueue()
        play = self.channel.stream_stream(PLAY, encode, pb.PlayResponse.FromString)
        self.responses = play(iter(self.requests.get, None), timeout=SECONDS, **call)

    def ask(self, request) -> pb.PlayResponse:
        """Send a request and return its response. Raises grpc.RpcError."""
        self.requests.put(request)
        return next(self.responses)

    def refusal(self, request) -> tuple[grpc.StatusCode, str]:
        """Send a request that must be refused, and return the status and its text."""
        with pytest.raises(grpc.RpcError) as caught:
            self.ask(request)
        return caught.value.code(), caught.value.details()

    def end(self) -> tuple[grpc.StatusCode, str]:
        """Wait for the server to end the stream, and return the status and its text."""
        with pytest.raises(grpc.RpcError) as caught:
            next(self.responses)
        return caught.value.code(), caught.value.details()

    def close(self):
        self.requests.put(None)
        self.channel.close()

    def __enter__(self):
        return self

    def __exit__(self, *error):
        self.close()


def encode(request) -> bytes:
    return request if isinstance(request, bytes) else request.SerializeToString()


def refused(address, *requests) -> tuple[grpc.StatusCode, str]:
    """Return status and text of the last request of a stream of its own; those before it must be answered."""
    with Stream(address) as stream:
        for request in requests[:-1]:
            stream.ask(request)
        return stream.refusal(requests[-1])


def describe(address, game, **options) -> pb.GameSpec:
    with grpc.insecure_channel(address) as channel:
        request = pb.DescribeGameRequest(game=game, options=options)
        return rpc.SimulatorServiceStub(channel).DescribeGame(request, timeout=SECONDS).spec


class Player:
    """Plays a session with random actions that depend on the seed and the arena's number alone, as the games do."""

    def __init__(self, address, game, arenas=2, seed=1, first_arena=0, **fields):
        self.stream = Stream(address)
        self.arenas = arenas
        self.random = [np.random.default_rng([7, first_arena + arena]) for arena in range(arenas)]
        started = self.stream.ask(start(game, arenas, seed, first_arena=first_arena, **fields)).started
        self.spec, self.socket = started.spec, started.local_socket
        self.step = started.step

    def acts(self) -> list[pb.BehaviorAct]:
        """Return valid actions for the present step."""
        steps = [
            Codec(kind, self.arenas).unpack_step(step)
            for step, kind in zip(self.step.behaviors, self.spec.behaviors, strict=True)
        ]
        pairs = zip(self.spec.behaviors, steps, strict=True)
        return [pack_act(self._choose(behavior, step)) for behavior, step in pairs]

    def _choose(self, behavior: pb.Behavior, step: StepArrays) -> ActArrays:
        lanes, device = len(step.rewards), behavior.device
        arrays = ActArrays(
            np.empty((lanes, len(device.axes)), np.float32), np.empty((lanes, len(device.branches)), np.int32)
        )
        for lane in range(lanes):
            random = self.random[lane // behavior.agents_per_arena]
            arrays.axes[lane] = [random.uniform(axis.low, axis.high) for axis in device.axes]
            for index, branch in enumerate(device.branches):
                allowed = step.masks[index][lane] if step.masks else np.ones(len(branch.choices), bool)
                arrays.choices[lane, index] = random.choice(np.flatnonzero(allowed))
        return arrays

    def play(self, decisions: int) -> list[bytes]:
        """Play some decisions and return the bytes of what happened, the clock on the wall left out."""
        return [record(self.ask(act(*self.acts()))) for _ in range(decisions)]

    def ask(self, request) -> pb.Step:
        self.step = self.stream.ask(request).step
        return self.step

    def save(self) -> pb.Snapshot:
        return self.stream.ask(SAVE).snapshot

    def __enter__(self):
        return self

    def __exit__(self, *error):
        self.stream.close()


def record(step: pb.Step) -> bytes:
    """Return the bytes of a step, the clock on the wall left out."""
    return pb.Step(behaviors=step.behaviors, pictures=step.pictures).SerializeToString(deterministic=True)
