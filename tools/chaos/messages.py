"""Malformed messages of all calls, each with a right status and no trace in the sessions beside it."""

import asyncio
import random
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import grpc
from google.protobuf.message import DecodeError, Message
from grpc import StatusCode
from grpc_health.v1 import health_pb2
from grpc_reflection.v1alpha import reflection_pb2

from joybridge.client.client import Session
from joybridge.contract.codec import pack_act
from joybridge.contract.credentials import NO_COMPRESSION
from joybridge.layouts import make_acts
from joybridge.v1 import bridge_pb2 as pb
from tools.chaos.outcome import Outcome
from tools.chaos.process import Simulator, mebibytes

GAME = "archer"  # with axes, branches and masks
AT_ONCE = 32  # calls
CALL_SECONDS = 60.0
SERVICE = "/joybridge.v1.SimulatorService/"
REFUSED = {
    StatusCode.INVALID_ARGUMENT,
    StatusCode.FAILED_PRECONDITION,
    StatusCode.NOT_FOUND,
    StatusCode.RESOURCE_EXHAUSTED,
}


class Method(NamedTuple):
    """A call of a server."""

    path: str
    kind: type[Message]
    streams: str  # the method of a channel that makes it
    valid: Sequence[Message]  # requests


def methods() -> list[Method]:
    """Return all calls of a server, with valid requests."""
    start = pb.PlayRequest(
        start=pb.Start(game=GAME, arenas=2, seed=1, version=pb.Version(product="chaos", revision=1), snapshot=None)
    )
    reset = pb.PlayRequest(reset=pb.Reset(seed=3))
    describe = pb.DescribeGameRequest(game="shooting_birds", options={"level": "3"})
    reflect = reflection_pb2.ServerReflectionRequest(file_containing_symbol="joybridge.v1.SimulatorService")
    return [
        Method(f"{SERVICE}Play", pb.PlayRequest, "stream_stream", [start, reset, pb.PlayRequest(save=pb.Save())]),
        Method(f"{SERVICE}ListGames", pb.ListGamesRequest, "unary_unary", [pb.ListGamesRequest(version=pb.Version())]),
        Method(f"{SERVICE}DescribeGame", pb.DescribeGameRequest, "unary_unary", [describe]),
        Method(
            "/grpc.health.v1.Health/Check",
            health_pb2.HealthCheckRequest,
            "unary_unary",
            [health_pb2.HealthCheckRequest(service="joybridge.v1.SimulatorService")],
        ),
        Method(
            "/grpc.health.v1.Health/Watch",
            health_pb2.HealthCheckRequest,
            "unary_stream",
            [health_pb2.HealthCheckRequest(service="joybridge.v1.SimulatorService")],
        ),
        Method(
            "/grpc.reflection.v1alpha.ServerReflection/ServerReflectionInfo",
            reflection_pb2.ServerReflectionRequest,
            "stream_stream",
            [reflect],
        ),
    ]


def damaged(data: bytes, chance: random.Random) -> bytes:
    """Return random bytes, or the bytes of a message with some changed, removed, repeated or put in."""
    if chance.random() < 0.1:
        return chance.randbytes(chance.randint(1, 64))
    message = bytearray(data)
    for _ in range(chance.randint(1, 2)):
        place = chance.randint(0, len(message))
        match chance.randrange(4):
            case 0:
                message[place : place + 1] = chance.randbytes(1)
            case 1:
                del message[place : place + chance.randint(1, 8)]
            case 2:
                message[place:place] = chance.randbytes(chance.randint(1, 8))
            case _:
                message[place:place] = message[max(0, place - chance.randint(1, 16)) : place]
    return bytes(message)


class Sender:
    """Sends malformed messages to a server and judges its answers."""

    def __init__(self, address: str, act: pb.PlayRequest) -> None:
        """act: a valid one for two arenas of GAME."""
        self.address = address
        self.methods = methods()
        self.play = [*self.methods[0].valid, act]
        self.statuses: Counter[str] = Counter()
        self.problems: list[str] = []

    async def send(self, numbers: Sequence[int]) -> None:
        """Send the messages of these numbers, many at once."""
        room = asyncio.Semaphore(AT_ONCE)
        options = [NO_COMPRESSION, ("grpc.max_receive_message_length", -1)]
        async with grpc.aio.insecure_channel(self.address, options) as channel:

            async def one(number: int) -> None:
                async with room:
                    await self._judge(channel, number)

            await asyncio.gather(*map(one, numbers))

    async def _judge(self, channel: Any, number: int) -> None:
        chance = random.Random(number)
        method = self.methods[0] if chance.random() < 0.5 else chance.choice(self.methods)
        before: list[Message] = []
        valid = chance.choice(method.valid)
        if method is self.methods[0]:
            before = [self.play[0], self.play[3]][: chance.randrange(3)]
            valid = chance.choice(self.play)
        data = damaged(valid.SerializeToString(), chance)
        code, text, answers = await self._call(channel, method, [*(m.SerializeToString() for m in before), data])
        self.statuses[code.name] += 1
        wanted = {StatusCode.OK} | REFUSED
        try:
            method.kind.FromString(data)
        except DecodeError:
            wanted = {StatusCode.INVALID_ARGUMENT}
        explained = text or not method.path.startswith(SERVICE)  # gRPC's health service says nothing
        right = answers >= len(before) if code is StatusCode.OK else explained and len(text) < 2000
        if not right or code not in wanted:
            self.problems.append(
                f"message {number} of {method.path}: {code.name} {text!r}, {answers} answers, {data!r}"
            )

    async def _call(self, channel: Any, method: Method, messages: list[bytes]) -> tuple[StatusCode, str, int]:
        """Return status, text and number of responses of a call."""
        function = getattr(channel, method.streams)(method.path)
        answers = 0
        try:
            if method.streams == "unary_unary":
                await function(messages[0], timeout=CALL_SECONDS)
                return StatusCode.OK, "", 1
            requests = iter(messages) if method.streams == "stream_stream" else messages[0]
            call = function(requests, timeout=CALL_SECONDS)
            async for data in call:
                answers += 1
                endless = method.streams == "unary_stream"  # a watch
                if endless or (method.kind is pb.PlayRequest and _goes_elsewhere(data)):
                    call.cancel()
                    break
        except grpc.aio.AioRpcError as error:
            return error.code(), error.details() or "", answers
        return StatusCode.OK, "", answers


def _goes_elsewhere(data: bytes) -> bool:
    """Return whether a response offers a Unix socket for the rest of the session."""
    return bool(pb.PlayResponse.FromString(data).started.local_socket)


def messages(folder: Path, faults: int) -> Outcome:
    """Send malformed messages to all calls of a server."""
    with Simulator("--start-seconds", "5") as simulator:
        with Session(simulator.address, GAME, arenas=2, seed=1) as session:
            act = pb.PlayRequest(act=pb.Act(behaviors=map(pack_act, make_acts(session.spec, 2))))
        sender = Sender(simulator.address, act)
        alone, beside = (Session(simulator.address, "shooting_birds", arenas=2, seed=7) for _ in range(2))
        acts = make_acts(alone.spec, 2)
        before = mebibytes(simulator.process.pid)
        for first in range(0, faults, 500):
            asyncio.run(sender.send(range(first, min(faults, first + 500))))
            step = beside.step(acts)
            if any((a != b).any() for a, b in zip(step[0].observations, alone.step(acts)[0].observations, strict=True)):
                sender.problems.append("a session beside them has other bytes")
        growth = mebibytes(simulator.process.pid) - before
        for session in (alone, beside):
            session.close()
        if simulator.process.poll() is not None:
            sender.problems.append(f"the server ended with {simulator.process.returncode}")
        if "Traceback" in simulator.said():
            sender.problems.append("a traceback in the server's log")
    statuses = ", ".join(f"{count:,} {name}" for name, count in sender.statuses.most_common())
    return Outcome(faults, sender.problems, f"{statuses}; the server's memory {growth:+.0f} MiB")
