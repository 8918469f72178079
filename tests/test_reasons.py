"""Every Reason of bridge.proto: the request that provokes it, over a connection within this process."""

import asyncio
import re
import socket
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import grpc
import numpy as np
import pytest
from google.rpc.error_details_pb2 import ErrorInfo
from google.rpc.status_pb2 import Status

from joybridge.contract.codec import ActArrays, pack_act
from joybridge.contract.local_socket import LENGTH
from joybridge.contract.statuses import CODES, details_of, status
from joybridge.simulator import service
from joybridge.simulator.authentication import TokenInterceptor
from joybridge.simulator.catalog import Catalog
from joybridge.simulator.service import Limits, Service
from joybridge.simulator.session import Refusal
from joybridge.v1 import bridge_pb2 as pb
from joybridge.v1 import bridge_pb2_grpc as rpc
from tests.support.broken_servers import Gauntlet
from tests.support.wire import PLAY, SAVE, SECONDS, act, encode, reset, start
from tools.generate_proto import PROTO, SOURCE

REASONS = [name.removeprefix("REASON_") for name in pb.Reason.keys() if name != "REASON_UNSPECIFIED"]  # noqa: SIM118


class Plain(Gauntlet):
    """Without pictures, snapshots and parameters per episode."""

    name = "plain"

    @classmethod
    def describe(cls, options):
        spec = super().describe(options)
        spec.ClearField("picture")
        spec.snapshot_bytes_per_arena = 0
        spec.parameters_per_episode = False
        return spec


class Fails(Gauntlet):
    name = "fails"

    def step(self, acts):
        raise RuntimeError("the wheel came off")


class Hangs(Gauntlet):
    name = "hangs"

    def step(self, acts):
        while True:
            pass


GAMES: Catalog = {game.name: game for game in (Gauntlet, Plain, Fails, Hangs)}
TOKEN = "0123456789abcdef"


class Case(NamedTuple):
    """Requests, the last of which is refused, and the field that is named; a server that has them refused."""

    requests: list[pb.PlayRequest | bytes]
    field: str = ""
    limits: Limits = Limits()
    token: str = ""
    others: int = 0  # sessions beside it
    ends: bool = False  # whether the server shuts down after the last request


def gauntlet_act(axes=1.0, gear=0, draw=(), judges=4):
    """Return an Act for two arenas of `gauntlet`."""
    player = ActArrays(np.array([[0.0, axes]] * 2, np.float32), np.array([[gear, 0]] * 2, np.int32))
    judge = ActArrays(np.empty((4, 0), np.float32), np.zeros((judges, 1), np.int32))
    runner = ActArrays(np.zeros((2, 1), np.float32), np.empty((2, 0), np.int32))
    return act(*map(pack_act, (player, judge, runner)), draw=draw)


START = start("gauntlet")
CASES = {
    "UNKNOWN_GAME": Case([start("chess")], "start.game"),
    "MALFORMED_MESSAGE": Case([b"\xff\xff"]),
    "UNKNOWN_REQUEST": Case([pb.PlayRequest()]),
    "UNKNOWN_OPTION": Case([start("gauntlet", options={"colour": "red"})], "start.options[colour]"),
    "UNKNOWN_CHOICE": Case([start("gauntlet", options={"size": "huge"})], "start.options[size]"),
    "UNKNOWN_PARAMETER": Case([start("gauntlet", parameters={"wind": 1.0})], "start.parameters[wind]"),
    "PARAMETER_OUT_OF_RANGE": Case([START, reset(parameters={"drift": 9.0})], "reset.parameters[drift]"),
    "NO_ARENAS": Case([start("gauntlet", arenas=0)], "start.arenas"),
    "WRONG_SNAPSHOT": Case([start("gauntlet", snapshot=pb.Snapshot(parts={"place": b""}))], "start.snapshot.parts"),
    "WRONG_BEHAVIORS": Case([START, act()], "act.behaviors"),
    "WRONG_TENSOR": Case([START, gauntlet_act(judges=3)], "act.behaviors[1].choices"),
    "NOT_FINITE": Case([START, gauntlet_act(axes=np.nan)], "act.behaviors[0].axes"),
    "ACTION_OUT_OF_RANGE": Case([START, gauntlet_act(axes=3.0)], "act.behaviors[0].axes"),
    "ACTION_MASKED": Case([START, gauntlet_act(gear=2)], "act.behaviors[0].choices"),
    "WRONG_DRAW": Case([START, gauntlet_act(draw=[2])], "act.draw"),
    "OLD_SERVER": Case([start("gauntlet", version=pb.Version(revision=1_000))]),
    "WRONG_ORDER": Case([SAVE]),
    "NO_SNAPSHOTS": Case([start("plain"), SAVE]),
    "NO_PICTURES": Case([start("plain"), gauntlet_act(draw=[0])], "act.draw"),
    "TOO_MANY_ARENAS": Case([start("gauntlet", arenas=17)], "start.arenas"),
    "TOO_MANY_SESSIONS": Case([START], limits=Limits(sessions=1), others=1),
    "MESSAGE_TOO_LARGE": Case([start("gauntlet", local_transport=True), LENGTH.pack(2**31)]),
    "GAME_FAILED": Case([start("fails"), gauntlet_act()]),
    "GAME_TOO_SLOW": Case([start("hangs"), gauntlet_act()], limits=Limits(step_seconds=0.2)),
    "NO_START": Case([b""], limits=Limits(start_seconds=0.0)),
    "IDLE": Case([START, b""], limits=Limits(idle_seconds=0.5)),
    "NO_TOKEN": Case([START], token=TOKEN),
    "WRONG_DISTRIBUTION": Case(
        [START, reset(distributions={"drift": pb.Distribution()})], "reset.distributions[drift]"
    ),
    "NO_DISTRIBUTIONS": Case(
        [start("plain", distributions={"drift": pb.Distribution(choice=pb.Values(values=[1.0]))})],
        "start.distributions[drift]",
    ),
    "SHUTTING_DOWN": Case([START, b""], ends=True),
}


@asynccontextmanager
async def serving(limits: Limits, token: str = "") -> AsyncIterator[tuple[Service, Callable[[], Any]]]:
    """Yield a server within this process and what opens a Play stream at it."""
    server = grpc.aio.server(interceptors=[TokenInterceptor(token)])
    servicer = Service(GAMES, limits)
    rpc.add_SimulatorServiceServicer_to_server(servicer, server)
    port = server.add_insecure_port("127.0.0.1:0")
    await server.start()
    try:
        async with grpc.aio.insecure_channel(f"127.0.0.1:{port}") as channel:
            play = channel.stream_stream(PLAY, encode, pb.PlayResponse.FromString)
            yield servicer, partial(play, timeout=SECONDS)
    finally:
        await server.stop(None)


async def refused(case: Case) -> grpc.aio.AioRpcError:
    """Play the requests of a case at a server of its own and return the error. b"" stands for silence."""
    async with serving(case.limits, case.token) as (servicer, play):
        sweeper = asyncio.create_task(servicer.sweep())
        others = [play() for _ in range(case.others)]
        for other in others:
            await other.write(START)
            await other.read()
        call = play()
        local_socket = ""
        for request in case.requests[:-1]:
            await call.write(request)
            local_socket = (await call.read()).started.local_socket
        if case.ends:
            servicer.end_streams()
        with pytest.raises(grpc.aio.AioRpcError) as caught:
            await ask_last(case.requests[-1], call, local_socket)
        sweeper.cancel()
        return caught.value


async def ask_last(request: pb.PlayRequest | bytes, call: Any, local_socket: str) -> None:
    """Send a request, over the socket if there is one, and wait for what follows."""
    if local_socket:
        with socket.socket(socket.AF_UNIX) as local:
            local.connect(local_socket)
            local.sendall(encode(request))
    elif request != b"":
        await call.write(request)
    await call.read()


@pytest.mark.parametrize("name", REASONS)
@pytest.mark.promise("P1")
def test_every_reason_is_provoked_and_sent_with_the_field_and_a_sentence(name, monkeypatch):
    monkeypatch.setattr(service, "SWEEP_SECONDS", 0.01)
    case = CASES[name]
    error = asyncio.run(refused(case))
    assert details_of(error) == (name, case.field)
    assert error.code() == CODES[pb.Reason.Value(f"REASON_{name}")]
    assert error.details()


async def idle_while_a_response_is_sent() -> grpc.aio.AioRpcError:
    """Let the time limit pass in the moment in which a response is being sent, and return the error."""
    async with serving(Limits(idle_seconds=0.0)) as (servicer, play):
        call = play()
        await call.write(START)
        while not any(stream.doing == service.WRITING for stream in servicer.streams):
            await asyncio.sleep(0)
        servicer.end_silent_streams()
        assert (await call.read()).HasField("started")
        with pytest.raises(grpc.aio.AioRpcError) as caught:
            await call.read()
        return caught.value


def test_a_limit_that_passes_while_a_response_is_sent_cuts_neither_response_nor_status():
    assert details_of(asyncio.run(idle_while_a_response_is_sent())) == ("IDLE", "")


async def socket_that_is_not_used() -> tuple[grpc.aio.AioRpcError, Path]:
    """Ask for a Unix socket and do not connect to it; return the error and the folder of the socket."""
    async with serving(Limits(start_seconds=0.1)) as (_, play):
        call = play()
        await call.write(start("gauntlet", local_transport=True))
        folder = Path((await call.read()).started.local_socket).parent
        with pytest.raises(grpc.aio.AioRpcError) as caught:
            await call.read()
        return caught.value, folder


def test_a_client_that_asks_for_a_socket_and_does_not_connect_loses_its_session_soon():
    error, folder = asyncio.run(socket_that_is_not_used())
    assert details_of(error) == ("IDLE", "")
    assert error.details() == "no connection to the socket (see --start-seconds) for 0.1 s; open a new stream"
    assert folder.name.startswith("joybridge-") and not folder.exists()


def test_the_manual_tells_the_status_of_every_reason():
    text = (PROTO / SOURCE).read_text()
    told = re.findall(r"^  REASON_(\w+) = \d+; +// ([A-Z_]+): [^ ]", text, re.MULTILINE)
    assert told == [(name, CODES[pb.Reason.Value(f"REASON_{name}")].name) for name in REASONS]


def test_the_longest_sentence_and_field_arrive():
    """They are cut to fit into the 8 KiB of a status, also where every character takes the most bytes."""
    text = "\U0001f426" * 10_000
    error = asyncio.run(refused(Case([start("gauntlet", options={text: text})])))
    reason, field = details_of(error)
    assert (error.code(), reason) == (grpc.StatusCode.INVALID_ARGUMENT, "UNKNOWN_OPTION")
    assert field.startswith("start.options[\U0001f426") and len(field) > 100 and len(error.details()) > 300
    refusal = Refusal(pb.REASON_UNKNOWN_OPTION, text, text)
    assert len(str(refusal)) > 300 and "…" in str(refusal) and "…" in refusal.field


class Error(NamedTuple):
    """What a client gets from gRPC when a call has failed."""

    metadata: list[tuple[str, bytes]] | None
    sentence: str = "no such game"

    def code(self):
        return grpc.StatusCode.NOT_FOUND

    def details(self):
        return self.sentence

    def trailing_metadata(self):
        return self.metadata


def sent(sentence="no such game", **info):
    message = Status(code=5, message=sentence)
    message.details.add().Pack(ErrorInfo(**info))
    return [("grpc-status-details-bin", message.SerializeToString())]


@pytest.mark.parametrize(
    "metadata",
    [
        None,
        [],
        [("other", b"x")],
        [("grpc-status-details-bin", b"\xff")],
        [("grpc-status-details-bin", Status(code=5, message="no such game").SerializeToString())],
        sent(domain="joybridge.v1", reason="BEWITCHED"),
        sent(domain="somebody.else", reason="UNKNOWN_GAME"),
        sent(domain="joybridge.v1", reason="UNKNOWN_GAME", sentence="another sentence"),
    ],
)
def test_servers_need_not_send_details_and_strange_ones_are_ignored(metadata):
    assert details_of(Error(metadata)) == ("", "")


def test_details_are_read_without_control_characters():
    code, sentence, metadata = status(pb.REASON_UNKNOWN_GAME, "no such game", "start.\x1b[2Jgame")
    assert (code, sentence) == (grpc.StatusCode.NOT_FOUND, "no such game")
    assert details_of(Error(list(metadata))) == ("UNKNOWN_GAME", r"start.\x1b[2Jgame")
