"""The server process: what it says, games that fail, limits, signals and addresses, over real sockets.

That it keeps the contract is the conformance kit's business, in test_check.py.
"""

import re
import signal
import socket
import stat
import subprocess
import sys
import time
from importlib import metadata

import grpc
import numpy as np
import pytest
from grpc import StatusCode
from grpc_health.v1 import health_pb2, health_pb2_grpc

from joybridge.contract.address import READY
from joybridge.contract.codec import Codec, Format, pack
from joybridge.contract.spec import check_spec
from joybridge.contract.versions import REVISION
from joybridge.games import BUILT_IN
from joybridge.simulator.catalog import CatalogError, load_games
from joybridge.v1 import bridge_pb2 as pb
from joybridge.v1 import bridge_pb2_grpc as rpc
from tests.support.faulty_game import FAULTS, PICTURE
from tests.support.games import PLACES
from tests.support.measured import measured
from tests.support.servers import ROOT, end, games, refuses_to_start, server
from tests.support.wire import SAVE, SECONDS, Player, Stream, act, describe, refused, reset, start

OWN = ["hybrid", "duel", "ends", "kick", "gallery", "raises", "brittle", "faulty", "batch"]
PAPER = ["beastly_rivals", "beastly_rivals_full", "shooting_birds"]  # built-in games that draw and save themselves
LISTED = [*OWN, *BUILT_IN]
GOOD = ["hybrid", "duel", "ends", "kick", "gallery", *BUILT_IN]
LARGEST_SEED = 2**64 - 1


@pytest.fixture(scope="module")
def simulator():
    """Yield the address of a server process that is measured if the tests are."""
    command = [*measured("joybridge.simulator"), "serve", "--address", "127.0.0.1:0", "--with-parent", *games(*PLACES)]
    with subprocess.Popen(command, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        yield process.stdout.readline().removeprefix(READY).strip()
        process.terminate()


def floats(*values):
    return pack(np.array(values, np.float32))


def integers(*values):
    return pack(np.array(values, np.int32))


def hybrid(axes=((0.0, 1.0), (0.0, 1.0)), choices=((0, 0), (0, 0)), draw=()):
    """Return an Act for two arenas of `hybrid`."""
    return act(pb.BehaviorAct(axes=floats(*axes), choices=integers(*choices)), draw=draw)


def press(lanes=2, draw=()):
    """Return an Act for a game with a single button."""
    return act(pb.BehaviorAct(choices=integers(*[[1]] * lanes)), draw=draw)


# ------------------------------------------------------------------------------------------------- the unary calls


def test_the_games_are_listed_and_described_as_they_say(simulator):
    with grpc.insecure_channel(simulator) as channel:
        stub = rpc.SimulatorServiceStub(channel)
        games = stub.ListGames(pb.ListGamesRequest(), timeout=SECONDS).games
        assert [game.name for game in games] == LISTED
        for game in games:
            spec = stub.DescribeGame(pb.DescribeGameRequest(game=game.name), timeout=SECONDS).spec
            check_spec(spec)
            assert (spec.name, spec.description) == (game.name, game.description) and spec.description


def unary_refusal(address, method, request):
    with grpc.insecure_channel(address) as channel, pytest.raises(grpc.RpcError) as caught:
        getattr(rpc.SimulatorServiceStub(channel), method)(request, timeout=SECONDS)
    return caught.value.code(), caught.value.details()


@pytest.mark.parametrize("fault", ["spec without sensors", "describe fails"])
def test_a_game_that_cannot_be_described_is_an_internal_error(simulator, fault):
    options = {"fault": fault, "armed": "yes"}
    for code, text in (
        unary_refusal(simulator, "DescribeGame", pb.DescribeGameRequest(game="faulty", options=options)),
        refused(simulator, start("faulty", options=options)),
    ):
        assert code == StatusCode.INTERNAL
        assert text.startswith("faulty failed in describe: ") and FAULTS[fault] in text


def test_every_response_states_the_version_of_the_server(simulator):
    wanted = pb.Version(product=f"joybridge {metadata.version('joybridge')}", revision=REVISION)
    with grpc.insecure_channel(simulator) as channel, Stream(simulator) as stream:
        stub = rpc.SimulatorServiceStub(channel)
        assert stub.ListGames(pb.ListGamesRequest(), timeout=SECONDS).version == wanted
        assert stub.DescribeGame(pb.DescribeGameRequest(game="hybrid"), timeout=SECONDS).version == wanted
        assert stream.ask(start("hybrid")).started.version == wanted


REFUSED = [  # what the session itself refuses, told in full; test_codec.py has what the codec refuses
    ([start("chess")], StatusCode.NOT_FOUND,
     f"no game named 'chess'; this server has {', '.join(LISTED)}; "
     "name one of your own as MODULE:CLASS after --game, or with --gym or --pygame"),
    ([start("hybrid", options={"colour": "red"})], StatusCode.INVALID_ARGUMENT,
     "hybrid: unknown option 'colour', expected one of size, masks"),
    ([start("hybrid", options={"size": "huge"})], StatusCode.INVALID_ARGUMENT,
     "hybrid: option 'size' got 'huge', expected one of small, large"),
    ([start("hybrid", parameters={"wind": 1.0})], StatusCode.INVALID_ARGUMENT,
     "hybrid: unknown parameter 'wind', expected one of drift"),
    ([start("hybrid"), reset(parameters={"drift": 2.5})], StatusCode.INVALID_ARGUMENT,
     "hybrid: parameter 'drift' got 2.5, expected 0..2"),
    ([start("hybrid", 0)], StatusCode.INVALID_ARGUMENT, "hybrid: arenas is 0, expected 1..1024"),
    ([start("hybrid", 1025)], StatusCode.RESOURCE_EXHAUSTED, "hybrid: arenas is 1025, expected 1..1024"),
    ([start("hybrid", version=pb.Version(product="joybridge 99", revision=REVISION + 1))],
     StatusCode.FAILED_PRECONDITION,
     f"the client (joybridge 99) needs contract revision {REVISION + 1}, the simulator "
     f"(joybridge {metadata.version('joybridge')}) has revision {REVISION}; "
     "update the simulator, or use a client of its version"),
    ([SAVE], StatusCode.FAILED_PRECONDITION, "save came before start; open a new stream and begin with start"),
    ([start("hybrid"), start("hybrid")], StatusCode.FAILED_PRECONDITION,
     "start came a second time; open a new stream and begin with start"),
    ([start("hybrid"), pb.PlayRequest()], StatusCode.INVALID_ARGUMENT,
     "an empty PlayRequest, or a request that this server does not know; send start, act, reset or save"),
    ([start("hybrid"), SAVE], StatusCode.FAILED_PRECONDITION,
     "hybrid has no snapshots (snapshot_bytes_per_arena is 0); begin new episodes instead"),
    ([start("hybrid"), act()], StatusCode.INVALID_ARGUMENT, "act.behaviors has 0 entries, expected 1"),
    ([start("hybrid"), hybrid(draw=[0, 2])], StatusCode.INVALID_ARGUMENT,
     "act.draw asks for 2 pictures up to arena 2, expected at most 64 of arenas 0..1"),
    ([start("ends"), press(draw=[0])], StatusCode.FAILED_PRECONDITION, "ends cannot be drawn; leave act.draw empty"),
]  # fmt: skip


@pytest.mark.parametrize(("requests", "code", "text"), REFUSED)
def test_a_refusal_says_what_came_what_was_wanted_and_what_to_do(simulator, requests, code, text):
    assert refused(simulator, *requests) == (code, text)


# ------------------------------------------------------------------------------------------------- games that play


def duel(paces, verdict):
    return act(pb.BehaviorAct(axes=floats(*[[p] for p in paces])), pb.BehaviorAct(choices=integers([verdict])))


def test_lanes_take_turns_and_hear_of_rewards_when_they_decide_or_end(simulator):
    with Stream(simulator) as stream:
        started = stream.ask(start("duel", arenas=1)).started
        kinds, step, deciders, earned = started.spec.behaviors, started.step, [], []
        for clock in range(10):
            parts = [Codec(kind, 1).unpack_step(message) for message, kind in zip(step.behaviors, kinds, strict=True)]
            flags = [flag for part in parts for flag in part.decides]
            deciders.append(flags.index(True))
            assert sum(flags) == 1
            step = stream.ask(duel([0.75, 0.25], 1)).step
            runners = Codec(kinds[0], 1).unpack_step(step.behaviors[0])
            earned.append(runners.rewards[:, 0].tolist())
            assert runners.truncated.all() == (clock == 9) and not runners.terminated.any()
    assert deciders == [0, 1, 2, 0, 1, 2, 0, 1, 2, 0]
    # A move pays its pace and costs the other runner 0.5.
    assert [first for first, _ in earned] == [0, 0, 0.25, 0, 0, 0.25, 0, 0, 0.25, 0.75]
    assert [second for _, second in earned] == [-0.5, 0, 0, -0.25, 0, 0, -0.25, 0, 0, -0.25]


def test_an_episode_ends_terminated_or_truncated_and_the_next_one_begins_in_the_same_step(simulator):
    with Stream(simulator) as stream:
        kind = stream.ask(start("ends")).started.spec.behaviors[0]
        steps = [Codec(kind, 2).unpack_step(stream.ask(press()).step.behaviors[0]) for _ in range(4)]
    assert [step.terminated.tolist() for step in steps] == [[False] * 2, [True] * 2, [False] * 2, [False] * 2]
    assert [step.truncated.tolist() for step in steps] == [[False] * 2, [False] * 2, [False] * 2, [True] * 2]
    assert [step.observations[0][0].tolist() for step in steps] == [[1, 1], [2, 0], [2, 1], [3, 0]]
    assert [step.final_observations and step.final_observations[0][0].tolist() for step in steps] == [
        None,
        [1, 2],
        None,
        [2, 2],
    ]


def test_pictures_come_in_the_order_in_which_they_are_asked_for(simulator):
    width, height = PICTURE
    with Stream(simulator) as stream:
        stream.ask(start("hybrid", parameters={"drift": 0.0}))
        request = hybrid(axes=[[0, 0.5]] * 2, choices=[[0, 1], [1, 0]], draw=[1, 0, 1])
        picture_format = Format(pb.DTYPE_UINT8, (height, width, 3), "picture")
        pictures = [picture_format.unpack(picture) for picture in stream.ask(request).step.pictures]
        assert [picture[0, 0].tolist() for picture in pictures] == [[1, 0, 1], [1, 1, 0], [1, 0, 1]]
        assert not stream.ask(hybrid()).step.pictures


# ------------------------------------------------------------------------------------------- games that fail


@pytest.mark.promise("F3")
def test_a_game_that_fails_ends_its_session_and_no_other(simulator):
    with Player(simulator, "hybrid", 3) as undisturbed:
        wanted = undisturbed.play(8)
    with Player(simulator, "hybrid", 3) as player, Stream(simulator) as failing:
        came = player.play(4)
        failing.ask(start("raises"))
        failing.ask(press())
        failing.ask(press())
        code, text = failing.refusal(press())
        came += player.play(4)
    assert code == StatusCode.INTERNAL
    assert text == (
        "raises failed in step 3: arena 0: ZeroDivisionError: division by zero; the traceback is in the server's log"
    )
    assert came == wanted


@pytest.mark.parametrize("fault", sorted(set(FAULTS) - {"spec without sensors", "describe fails"}))
def test_no_mistake_of_a_game_travels_as_data_or_blames_the_client(simulator, fault):
    at_start = fault in ("end at reset", "start fails")
    request = start("faulty", options={"fault": fault, "armed": "yes"})
    code, text = refused(simulator, *([request] if at_start else [request, press(draw=[0])]))
    assert code == StatusCode.INTERNAL
    assert text.startswith(f"faulty failed in step {0 if at_start else 1}: arena 0: ")
    assert FAULTS[fault] in text and text.endswith("; the traceback is in the server's log")


@pytest.mark.parametrize(
    ("fault", "text"), [("exit", "SystemExit: 5"), ("doubles", "TensorError: an array of float64 cannot be sent")]
)
def test_no_mistake_of_a_batched_game_brings_the_server_down_or_blames_the_client(simulator, fault, text):
    code, came = refused(simulator, start("batch", options={"fault": fault}), press())
    assert code == StatusCode.INTERNAL and came.startswith(f"batch failed in step 1: {text}")


def test_games_without_a_fault_play_on(simulator):
    with Stream(simulator) as stream:
        stream.ask(start("faulty", options={"armed": "yes"}))
        assert len(stream.ask(press(draw=[0])).step.pictures) == 1
    with Stream(simulator) as stream:
        stream.ask(start("batch"))
        assert len(stream.ask(press()).step.behaviors) == 1


@pytest.mark.parametrize(
    ("place", "text"),
    [
        ("nowhere", "game 'nowhere' cannot be imported"),
        ("nowhere:Game", "game 'nowhere:Game' cannot be imported"),
        ("tests.support.games:Chess", "game 'tests.support.games:Chess' cannot be imported"),
        ("", "game '' cannot be imported"),
        ("tests.support.games:PICTURE", "is not a subclass of joybridge.simulator.Game or BatchedGame"),
        ("tests.support.games:Unnamed", "game 'tests.support.games:Unnamed' cannot be described: AttributeError"),
        (
            "tests.support.games:BrokenChoice",
            "spec that violates the contract: broken_choice.player: agents_per_arena is 0",
        ),
    ],
)
def test_a_game_that_cannot_be_served_is_refused_before_the_server_starts(place, text):
    with pytest.raises(CatalogError) as caught:
        load_games([place])
    assert text in str(caught.value)


def test_two_games_cannot_have_one_name():
    with pytest.raises(CatalogError, match="there is already a game named 'hybrid'; rename this one"):
        load_games(["tests.support.games:Hybrid", "tests.support.games:Namesake"])


@pytest.mark.promise("X4")
def test_long_names_are_refused_with_their_own_status_in_few_words(simulator):
    for name in ("x" * 1_000_000, "ü" * 100_000, "🦆" * 100_000, "\x00\n%" * 100_000):
        for code, text in (
            refused(simulator, start(name)),
            refused(simulator, start("hybrid", options={name: name})),
            refused(simulator, start("hybrid", parameters={name: 1.0})),
            refused(simulator, start("shooting_birds", snapshot=pb.Snapshot(parts={name: b""}))),
        ):
            assert code in (StatusCode.NOT_FOUND, StatusCode.INVALID_ARGUMENT)
            assert repr(name)[:100] in text and len(text) < 700


# -------------------------------------------------------------------------------------- processes and addresses


def test_port_0_is_a_free_port_that_is_told(simulator):
    host, port = simulator.rsplit(":", 1)
    assert host == "127.0.0.1" and int(port) > 0
    with socket.create_connection((host, int(port)), SECONDS):
        pass


def test_a_port_in_use_is_an_error_that_says_so(simulator):
    text = refuses_to_start("--address", simulator)
    assert text == f"error: cannot listen on {simulator}: it is in use or not an address of this machine"


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT], ids=["SIGTERM", "SIGINT"])
def test_a_signal_ends_health_then_sessions_then_the_server(number):
    with server("--address", "127.0.0.1:0", *games("tests.support.games:Ends"), stderr=subprocess.PIPE) as process:
        with (
            grpc.insecure_channel(process.address) as channel,
            Stream(process.address) as playing,
            Stream(process.address) as waiting,
        ):
            playing.ask(start("ends"))
            playing.ask(press())
            assert waiting.ask(start("shooting_birds")).started.spec.name == "shooting_birds"
            watch = health_pb2_grpc.HealthStub(channel).Watch(
                health_pb2.HealthCheckRequest(service="joybridge.v1.SimulatorService"), timeout=SECONDS
            )
            assert next(watch).status == health_pb2.HealthCheckResponse.SERVING
            process.send_signal(number)
            assert next(watch).status == health_pb2.HealthCheckResponse.NOT_SERVING
            watch.cancel()
            assert playing.end() == waiting.end() == (StatusCode.UNAVAILABLE, "the simulator is shutting down")
        status, text = end(process)
    assert status == 0
    assert "shutting down: 2 open sessions end with UNAVAILABLE" in text and "Traceback" not in text


def test_a_unix_socket_carries_the_same_bytes_and_can_be_used_again_after_a_crash(simulator, tmp_path_factory):
    path = tmp_path_factory.mktemp("s") / "s"  # short: the path of a socket has about a hundred characters at most
    address = f"unix:{path}"
    with server("--address", address, *games(*PLACES), umask=0) as process:
        assert process.address == address
        assert stat.S_IMODE(path.stat().st_mode) == 0o600  # for its owner alone
        for game in GOOD:
            with Player(address, game) as one, Player(simulator, game) as other:
                assert one.play(12) == other.play(12)
        assert (
            refuses_to_start("--address", address) == f"error: cannot listen on {address}: another server listens there"
        )
        with Player(address, "ends") as player:
            player.play(1)
    assert path.exists()  # the server was killed
    with server("--address", address) as process:
        assert describe(address, "shooting_birds").name == "shooting_birds"
        process.terminate()
        assert end(process)[0] == 0
    assert not path.exists()


CLIENT = """
import sys
from tests.support.wire import Stream, start
stream = Stream(sys.argv[1])
stream.ask(start("shooting_birds"))
print("playing", flush=True)
sys.stdin.read()
"""


@pytest.mark.promise("F7")
def test_sessions_are_limited_and_one_that_ends_makes_room_however_it_ends():
    arguments = ["--address", "127.0.0.1:0", "--sessions", "2", "--with-parent"]
    with server(*arguments, stdin=subprocess.PIPE, stderr=subprocess.DEVNULL) as process:
        address = process.address
        client = [sys.executable, "-c", CLIENT, address]
        with Player(address, "shooting_birds") as first:
            with subprocess.Popen(client, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as child:
                assert child.stdout is not None and child.stdout.readline() == "playing\n"
                assert_full(address)
                assert describe(address, "shooting_birds").name == "shooting_birds"  # only sessions are limited
                child.kill()
            with room(address) as second:
                first.play(1)
                assert_full(address)
                second.close()
                with room(address):
                    first.play(1)
            with room(address) as third:
                third.refusal(pb.PlayRequest())
                with room(address):
                    first.play(1)
            assert process.stdin is not None
            process.stdin.close()  # as if its parent had died
            assert first.stream.end() == (StatusCode.UNAVAILABLE, "the simulator is shutting down")
        process.stdin = None
        assert end(process)[0] == 0


def assert_full(address):
    code, text = refused(address, start("shooting_birds"))
    assert code == StatusCode.RESOURCE_EXHAUSTED
    idle, advice = r"2 sessions are open already, one of them idle for \d+ s", "start the server with --sessions"
    assert re.fullmatch(f"{idle}; close one or {advice}", text)


def room(address) -> Stream:
    """Return a started session as soon as the server has noticed that another one has gone."""
    deadline = time.monotonic() + SECONDS
    while True:
        stream = Stream(address)
        try:
            stream.ask(start("shooting_birds"))
        except grpc.RpcError as error:
            stream.close()
            if error.code() != StatusCode.RESOURCE_EXHAUSTED or time.monotonic() > deadline:
                raise
            time.sleep(0.01)
        else:
            return stream


def test_a_parent_is_watched_through_a_pipe_and_nothing_else():
    text = refuses_to_start("--address", "127.0.0.1:0", "--with-parent", stdin=subprocess.DEVNULL)
    assert text == "error: --with-parent watches standard input, which must be a pipe or a terminal"


def test_a_game_that_cannot_be_served_keeps_the_server_from_starting():
    text = refuses_to_start("--address", "127.0.0.1:0", "--game", "tests.support.games:Chess")
    assert text.startswith("error: game 'tests.support.games:Chess' cannot be imported (")
