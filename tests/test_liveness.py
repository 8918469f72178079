"""A game that hangs, or a client that is silent, costs its own session and nothing else."""

import asyncio
import ctypes
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from functools import partial

import grpc
import numpy as np
import pytest
from grpc import StatusCode
from grpc_health.v1 import health_pb2, health_pb2_grpc

from joybridge.client.client import Session
from joybridge.client.errors import SimulatorError, SimulatorLost
from joybridge.contract.codec import pack
from joybridge.contract.local_socket import LENGTH
from joybridge.layouts import make_acts
from joybridge.simulator.game_thread import GameThread, TakesTooLong
from joybridge.v1 import bridge_pb2 as pb
from joybridge.v1 import bridge_pb2_grpc as rpc
from tests.support.hanging_games import HANGING, PLACES, RAISED
from tests.support.servers import Server, end, games, server
from tests.support.wire import SECONDS, Player, Stream, act, refused, start
from tools.chaos.proxy import Proxy

FROZEN_SECONDS = 40.0
LIMITS = ["--step-seconds", "1", "--start-seconds", "1", "--idle-seconds", "2"]


@pytest.fixture(scope="module")
def hasty() -> Iterator[Server]:
    """Yield a server that waits for nobody long."""
    arguments = ["--address", "127.0.0.1:0", *LIMITS, *games(*PLACES)]
    with server(*arguments, stderr=subprocess.DEVNULL) as process:
        yield process


def press(draw=()):
    return act(pb.BehaviorAct(choices=pack(np.ones((2, 1), np.int32))), draw=draw)


@pytest.mark.parametrize(("game", "how"), [("hangs", "loop"), ("hangs", "draw"), ("hangs_at_once", "sleep")])
@pytest.mark.promise("P7")
def test_a_game_that_hangs_disturbs_nobody_and_loses_its_session_after_the_limit(hasty, game, how):
    with (
        grpc.insecure_channel(hasty.address) as channel,
        Player(hasty.address, "shooting_birds") as player,
        Stream(hasty.address) as stream,
    ):
        player.play(3)
        stream.ask(start(game, options={"how": how}))
        refusals = []
        waiting = threading.Thread(
            target=lambda: refusals.append(stream.refusal(press(draw=[0] if how == "draw" else [])))
        )
        waiting.start()
        health, simulator = health_pb2_grpc.HealthStub(channel), rpc.SimulatorServiceStub(channel)
        for _ in range(10):
            health.Check(health_pb2.HealthCheckRequest(), timeout=SECONDS)
            simulator.ListGames(pb.ListGamesRequest(), timeout=SECONDS)
            simulator.DescribeGame(pb.DescribeGameRequest(game=game), timeout=SECONDS)
            player.play(1)
        assert not refusals  # all of this while the game hung
        waiting.join(SECONDS)
    ((code, text),) = refusals
    assert code == StatusCode.INTERNAL
    assert text.startswith(
        f"{game} failed in step 1 of 2 arenas: no result after 1 s; its stack is in the server's log"
    )


def test_a_game_whose_description_hangs_delays_the_descriptions_of_no_other_game(hasty):
    options = {"how": "describe", "armed": "yes"}
    with grpc.insecure_channel(hasty.address) as channel:
        stub = rpc.SimulatorServiceStub(channel)
        hanging = stub.DescribeGame.future(pb.DescribeGameRequest(game="hangs", options=options), timeout=SECONDS)
        stub.DescribeGame(pb.DescribeGameRequest(game="hangs_at_once"), timeout=SECONDS)
        assert not hanging.done()
        assert hanging.code() == StatusCode.INTERNAL
        assert hanging.details().startswith("hangs failed in describe: no result after 1 s")
    code, text = refused(hasty.address, start("hangs", options=options))
    assert code == StatusCode.INTERNAL and text.startswith("hangs failed in step 0: no result after 1 s")


@pytest.mark.parametrize("game", ["hangs", "hangs_at_once"])
@pytest.mark.parametrize("how", RAISED)
def test_a_game_that_raises_what_is_no_error_ends_its_session_only(hasty, game, how):
    with Player(hasty.address, "shooting_birds") as player:
        code, text = refused(hasty.address, start(game, options={"how": how}), press())
        player.play(1)
    assert code == StatusCode.INTERNAL and text.startswith(f"{game} failed in step 1: ")
    assert RAISED[how].__name__ in text


@pytest.mark.promise("S2")
def test_a_stream_without_a_start_is_ended_and_takes_no_place():
    arguments = ["--address", "127.0.0.1:0", "--sessions", "1", *LIMITS]
    with server(*arguments, stderr=subprocess.DEVNULL) as process, Stream(process.address) as silent:
        with Player(process.address, "shooting_birds") as player:
            player.play(1)
        code, text = silent.end()
    assert code == StatusCode.DEADLINE_EXCEEDED
    assert text == "no start (see --start-seconds) for 1 s; open a new stream"


def test_who_may_wait_for_ever_for_a_start_offers_a_socket_all_the_same():
    arguments = ["--address", "127.0.0.1:0", "--start-seconds", "0"]
    with (
        server(*arguments, stderr=subprocess.DEVNULL) as process,
        Player(process.address, "shooting_birds", local_transport=True) as player,
    ):
        assert player.socket


@pytest.mark.promise("S2")
def test_a_session_whose_client_is_silent_is_ended_and_one_that_plays_is_not(hasty):
    with Player(hasty.address, "shooting_birds") as player, Player(hasty.address, "shooting_birds") as silent:
        ended = threading.Event()
        silent.stream.responses.add_callback(ended.set)
        while not ended.is_set():
            player.play(1)
            time.sleep(0.05)
        assert silent.stream.end() == (
            StatusCode.DEADLINE_EXCEEDED,
            "no request (see --idle-seconds) for 2 s; open a new stream",
        )
        player.play(1)


@pytest.mark.promise("S2")
def test_a_client_that_does_not_read_its_socket_hears_over_the_stream_why_it_ended(hasty):
    with Player(hasty.address, "shooting_birds", local_transport=True) as greedy:
        pictures = act(*greedy.acts(), draw=[0, 1] * 8).SerializeToString()
        with socket.socket(socket.AF_UNIX) as unread:
            unread.connect(greedy.socket)
            for _ in range(9):
                unread.sendall(LENGTH.pack(len(pictures)) + pictures)
            status, text = greedy.stream.end()
    assert status is StatusCode.DEADLINE_EXCEEDED and "for 2 s; open a new stream" in text


def test_a_client_that_leaves_with_pictures_unread_is_no_error():
    with server("--address", "127.0.0.1:0", stderr=subprocess.PIPE) as process:
        with Player(process.address, "shooting_birds") as player, Player(process.address, "archer") as greedy:
            pictures = act(*greedy.acts(), draw=[0, 1] * 8)
            for _ in range(9):
                greedy.stream.requests.put(pictures)
            player.play(40)  # until the server cannot send any more
            greedy.stream.responses.cancel()
            player.play(10)
        process.terminate()
        status, text = end(process)
    assert status == 0 and "Traceback" not in text


def test_a_signal_ends_a_server_whose_games_hang_and_the_log_says_where():
    arguments = ["--address", "127.0.0.1:0", *games(*PLACES)]
    with server(*arguments, stderr=subprocess.PIPE) as process:
        with Stream(process.address) as one, Stream(process.address) as other:
            assert process.stdout is not None
            for stream, how in ((one, "loop"), (other, "sleep")):
                stream.ask(start("hangs", options={"how": how}))
                stream.requests.put(press())
                assert process.stdout.readline().strip() == HANGING
            process.terminate()
            assert one.end() == other.end() == (StatusCode.UNAVAILABLE, "the simulator is shutting down")
        status, text = end(process)
    assert status == 0
    assert text.count("the server ends although a game is still working") == 2
    assert text.count("hanging_games.py") == 2 and "time.sleep(FOREVER)" in text


def test_a_thread_whose_session_has_not_ended_it_is_no_game_that_works():
    program = """
import asyncio
from joybridge.simulator.game_thread import GameThread
from joybridge.simulator.server import _end_games
thread = GameThread(60.0)
asyncio.run(thread.answer(int))
_end_games()
print(thread.is_alive())
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert (done.stdout, done.stderr) == ("False\n", "")


def test_a_game_is_closed_although_its_time_was_over_just_after_it_had_finished():
    thread, closed = GameThread(60.0), threading.Event()
    asyncio.run(thread.answer(int))
    ctypes.pythonapi.PyThreadState_SetAsyncExc(ctypes.c_ulong(thread.ident or 0), ctypes.py_object(TakesTooLong))
    thread.end(closed.set)
    assert closed.wait(5)
    thread.join(5)
    assert not thread.is_alive()


def test_a_signal_ends_a_server_whose_game_has_closed_standard_error():
    arguments = ["--address", "127.0.0.1:0", *games(*PLACES)]
    with server(*arguments, stderr=subprocess.PIPE) as process, Stream(process.address) as stream:
        stream.ask(start("hangs", options={"how": "stderr"}))
        stream.ask(press())
        process.terminate()  # with an open session, so that the server logs what it ends
        assert process.wait(SECONDS) == 0


def test_a_signal_ends_a_server_even_if_its_event_loop_hangs():
    arguments = ["--address", "127.0.0.1:0", *games(*PLACES)]
    with (
        server(*arguments, stderr=subprocess.PIPE) as process,
        Stream(process.address) as stream,
    ):
        stream.ask(start("hangs_the_loop"))
        stream.ask(press())
        stream.requests.put(press())
        assert process.stdout is not None and process.stdout.readline().strip() == HANGING
        process.terminate()
        status, text = end(process)
    assert status == 1
    assert "hanging_games.py" in text and "in step" in text


FROZEN = """
import sys
from joybridge.client.client import Session
session = Session(sys.argv[1], "archer", arenas=1, seed=1, transport=sys.argv[2])
print("ready", flush=True)
sys.stdin.read()
"""


@pytest.mark.nightly
@pytest.mark.skipif(not hasattr(signal, "SIGSTOP"), reason="this system stops no processes")
@pytest.mark.parametrize("transport", ["grpc", "local"])
@pytest.mark.promise("L3")
def test_a_client_that_is_frozen_loses_its_place(transport):
    """It takes 13 s; gRPC's own time for a ping is a minute, so FROZEN_SECONDS tells them apart."""
    with server("--address", "127.0.0.1:0", "--sessions", "1") as process:
        command = [sys.executable, "-c", FROZEN, process.address, transport]
        with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as client:
            assert client.stdout and client.stdout.readline() == "ready\n"
            client.send_signal(signal.SIGSTOP)
            until = time.monotonic() + FROZEN_SECONDS
            while not is_free(process.address):
                assert time.monotonic() < until
                time.sleep(0.2)
            client.kill()


def is_free(address):
    try:
        Session(address, "archer", arenas=1, seed=1).close()
    except SimulatorError:
        return False
    return True


@pytest.mark.nightly
@pytest.mark.skipif(not hasattr(signal, "SIGSTOP"), reason="this system stops no processes")
@pytest.mark.parametrize("transport", ["grpc", "local"])
@pytest.mark.promise("L3")
def test_a_server_that_is_frozen_is_lost_to_its_client(transport):
    """It takes 14.5 s at most, as above."""
    with server("--address", "127.0.0.1:0") as process:
        session = Session(process.address, "archer", arenas=1, seed=1, transport=transport, timeout=FROZEN_SECONDS)
        is_lost(session, lambda: process.send_signal(signal.SIGSTOP))


@pytest.mark.nightly
@pytest.mark.promise("L3")
def test_a_server_whose_connection_swallows_every_byte_is_lost_to_its_client(simulator):
    proxy = Proxy(simulator)
    session = Session(proxy.address, "archer", arenas=1, seed=1, transport="grpc", timeout=FROZEN_SECONDS)
    is_lost(session, proxy.swallow)


def is_lost(session, lose):
    with session:
        play_on(session, 1)
        lose()
        with pytest.raises(SimulatorLost, match="it does not even answer pings"):
            play_on(session, 1_000_000)  # a signal may come after some steps


def play_on(session, decisions):
    acts = make_acts(session.spec, 1)
    for _ in range(decisions):
        session.step(acts)


@pytest.mark.nightly
@pytest.mark.parametrize("transport", ["grpc", "local"])
@pytest.mark.promise("L3")
def test_a_server_whose_game_works_for_long_is_not_lost(transport):
    """Its client pings three times, and hears at last that the game took too long."""
    arguments = ["--address", "127.0.0.1:0", "--step-seconds", "33", *games(*PLACES)]
    hanging = partial(Session, game="hangs", options={"how": "sleep"}, arenas=1, seed=1, timeout=SECONDS)
    with (
        server(*arguments, stderr=subprocess.DEVNULL) as process,
        hanging(process.address, transport=transport) as session,
        pytest.raises(SimulatorError, match="no result after 33 s"),
    ):
        session.step(make_acts(session.spec, 1))
