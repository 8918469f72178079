"""The messages of a session over a Unix socket: the same bytes and the same ends as over gRPC, or gRPC."""

import socket
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from queue import SimpleQueue
from threading import Thread

import grpc
import numpy as np
import pytest

from joybridge.client.client import Session, SimulatorError, SimulatorLost
from joybridge.client.local_stream import LocalStream
from joybridge.conformance.expectations import Unreachable
from joybridge.conformance.runner import run_checks
from joybridge.conformance.selection import select
from joybridge.contract.local_socket import LENGTH, FrameError, LocalSocket
from joybridge.contract.versions import own_version
from joybridge.layouts import make_acts
from joybridge.simulator.local_socket import LocalListener
from joybridge.v1 import bridge_pb2 as pb
from tests.support.broken_servers import Gauntlet, Honest
from tests.support.servers import answering_methods, impatient
from tests.support.wire import Stream, act, reset, start


def is_local(session: Session) -> bool:
    return isinstance(session._stream, LocalStream)


def local(session: Session) -> LocalStream:
    assert isinstance(session._stream, LocalStream)
    return session._stream


def test_a_session_over_the_socket_has_the_bytes_of_one_over_the_stream(simulator):
    played = []
    for transport in ("auto", "local", "grpc"):
        with Session(simulator, "shooting_birds", arenas=3, seed=4, transport=transport) as session:
            assert is_local(session) == (transport != "grpc")
            acts = make_acts(session.spec, 3)
            steps = [session.step(acts) for _ in range(3)]
            session.send(acts)
            steps.append(session.receive())
            _, pictures = session.step_and_draw(acts, [2, 0])
            snapshot = session.save()
            steps.append(session.reset(seed=9))
            arrays = [array for step in steps for array in step[0].observations] + pictures
            played.append((b"".join(array.tobytes() for array in arrays), snapshot))
    assert played[0] == played[1] == played[2]


def test_an_error_ends_the_session_with_the_same_text(simulator):
    texts = []
    for transport in ("local", "grpc"):
        with Session(simulator, "archer", arenas=2, seed=0, transport=transport) as session:
            acts = make_acts(session.spec, 2)
            acts[0].axes[1, 0] = np.nan
            with pytest.raises(SimulatorError, match="INVALID_ARGUMENT") as caught:
                session.step(acts)
            texts.append(str(caught.value))
    assert texts[0] == texts[1]


def test_a_message_of_the_session_that_is_too_large_is_refused(simulator):
    with Session(simulator, "archer", arenas=1, seed=0, transport="local") as session:
        with suppress(BrokenPipeError):  # it is refused before it has been sent completely
            local(session)._socket.send(b"\0" * 1_000_000, 10.0)
        local(session)._pending = pb.PlayRequest(act=pb.Act())
        with pytest.raises(SimulatorError, match=r"a request of 1000000 bytes, .* \(RESOURCE_EXHAUSTED\)"):
            session.receive()


def test_the_socket_is_for_one_client_and_leaves_nothing_behind(simulator):
    request = start("archer")
    request.start.local_transport = True
    with Stream(simulator) as stream:
        path = stream.ask(request).started.local_socket
        assert Path(path).parent.stat().st_mode & 0o777 == 0o700
        first = LocalSocket(path, 1 << 20)
        first.send(act().SerializeToString(), 10.0)
        with pytest.raises(grpc.RpcError) as caught:  # the session has ended with the wrong action
            next(stream.responses)
        assert caught.value.code() is grpc.StatusCode.INVALID_ARGUMENT
        assert first.receive(10.0) is None
        assert not Path(path).parent.exists()
        first.close()


def test_the_kit_passes_over_the_socket(simulator):
    families = ["sessions", "order", "actions", "snapshots", "pictures"]
    results = list(run_checks(simulator, ["orchard"], 60.0, select(families=families), transport="local"))
    assert {result.outcome for result in results} <= {"passed", "not applicable"}, results


# ------------------------------------------------------------------------------------- servers that offer it wrongly


@contextmanager
def offering(path: str, *, unasked: bool = False) -> Iterator[str]:
    """Yield the address of a server that offers a socket at a path, and that plays over gRPC."""
    spec = pb.DescribeGameResponse(spec=Gauntlet.describe({"size": "small"}), version=own_version())
    games = pb.ListGamesResponse(games=[pb.GameSummary(name="gauntlet", description="A game.")], version=own_version())

    def play(requests, context):
        server = Honest({Gauntlet.name: Gauntlet})
        for data in requests:
            request = pb.PlayRequest.FromString(data)
            response = server.answer(request)
            if request.start.local_transport or (unasked and request.HasField("start")):
                response.started.local_socket = path
            yield response.SerializeToString()

    with answering_methods(
        ListGames=lambda *_: games.SerializeToString(), DescribeGame=lambda *_: spec.SerializeToString(), Play=play
    ) as address:
        yield address


def test_a_socket_that_cannot_be_reached_leaves_grpc_or_is_named(tmp_path):
    """As in a container, whose files are not those of its client."""
    tmp_path.chmod(0o700)
    with offering(str(tmp_path / "nowhere")) as address:
        with Session(address, "gauntlet", arenas=2, seed=0) as session:
            assert not is_local(session)
            session.step(make_acts(session.spec, 2))
        with pytest.raises(SimulatorError, match=r"no local transport to .*No such file.*; leave it to transport=auto"):
            Session(address, "gauntlet", arenas=2, seed=0, transport="local")


def test_a_socket_that_was_not_asked_for_is_ignored():
    with offering("/nowhere", unasked=True) as address:
        for transport in ("grpc", "auto"):
            with Session(address, "gauntlet", arenas=2, seed=0, transport=transport) as session:
                assert not is_local(session)
                session.step(make_acts(session.spec, 2))


def test_a_server_without_the_transport_is_played_over_grpc_or_named(tmp_path):
    with offering("") as address:
        with Session(address, "gauntlet", arenas=2, seed=0) as session:
            assert not is_local(session)
        with pytest.raises(SimulatorError, match=r"no local transport to .*: the simulator does not offer it"):
            Session(address, "gauntlet", arenas=2, seed=0, transport="local")
        with pytest.raises(Unreachable, match="the server offers no local transport"):
            list(run_checks(address, transport="local"))


@contextmanager
def socket_that_sends(data: bytes) -> Iterator[str]:
    """Yield the path of a socket that answers its first client's request with these bytes, and then nothing else."""
    with tempfile.TemporaryDirectory() as folder, socket.socket(socket.AF_UNIX) as listener:
        path = str(Path(folder) / "socket")
        listener.bind(path)
        listener.listen()

        def send() -> None:
            connection, _ = listener.accept()
            with connection, suppress(ConnectionError):
                connection.recv(1 << 16)
                connection.sendall(data)
                while connection.recv(1 << 16):
                    pass

        thread = Thread(target=send)
        thread.start()
        yield path
        thread.join()


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", r"has not answered for 0\.1 s: gauntlet, arenas 0 to 1, after 0 steps, waiting for the answer to act"),
        (b"\5\0\0\0abc", r"has not answered for 0\.1 s"),
        (LENGTH.pack(2**32 - 1), "broke the contract: a message of 4294967295 bytes, expected at most"),
        (LENGTH.pack(3) + b"abc", "sent what is no PlayResponse"),
        (LENGTH.pack(2) + b"\x1a\0", "answered with snapshot, expected step"),
    ],
)
def test_what_a_socket_sends_wrongly_is_named(data, message):
    with (
        socket_that_sends(data) as path,
        offering(path) as address,
        Session(address, "gauntlet", arenas=2, seed=0, transport="local") as session,
    ):
        impatient(session)
        for _ in range(2):
            with pytest.raises(SimulatorError, match=message):
                session.step(make_acts(session.spec, 2))


def test_a_response_without_a_request_ends_the_session():
    server = Honest({Gauntlet.name: Gauntlet})
    server.answer(start("gauntlet"))
    answer = server.answer(reset()).SerializeToString()
    with (
        socket_that_sends(2 * (LENGTH.pack(len(answer)) + answer)) as path,
        offering(path) as address,
        Session(address, "gauntlet", arenas=2, seed=0, transport="local") as session,
    ):
        session.reset()
        with pytest.raises(
            SimulatorError, match=r"sent a response without a request \(gauntlet, arenas 0 to 1, after 1 steps\)"
        ):
            session.reset()


def test_a_socket_whose_folder_is_open_to_others_is_not_used(tmp_path):
    """A hostile server could otherwise make its client talk to any socket of the machine."""
    tmp_path.chmod(0o755)
    with pytest.raises(PermissionError, match="must belong to this user alone"):
        LocalSocket(str(tmp_path / "socket"), 1)


def test_a_server_that_takes_no_connection_is_not_waited_for(tmp_path):
    tmp_path.chmod(0o700)
    with socket.socket(socket.AF_UNIX) as server, socket.socket(socket.AF_UNIX) as other:
        server.bind(str(tmp_path / "session"))
        server.listen(0)
        other.connect(str(tmp_path / "session"))  # its queue is full
        with pytest.raises(BlockingIOError):
            LocalSocket(str(tmp_path / "session"), 100)


def test_a_message_may_come_in_pieces_and_several_at_once():
    with socket_that_sends(b"".join(LENGTH.pack(n) + bytes(n) for n in (1, 200_000, 3))) as path:
        connection = LocalSocket(path, 1 << 20)
        connection.send(b"?", 10.0)
        assert [connection.receive(10.0) for _ in range(3)] == [bytes(1), bytes(200_000), bytes(3)]
        connection.close()
    with socket_that_sends(LENGTH.pack(9)) as path:
        connection = LocalSocket(path, 8)
        connection.send(b"?", 10.0)
        with pytest.raises(FrameError, match="of 9 bytes, expected at most 8"):
            connection.receive(10.0)
        connection.close()


@pytest.mark.parametrize("peer", ["ipv4:10.1.2.3:5000", "ipv6:%5B2001:db8::1%5D:5000", ""])
def test_clients_of_other_machines_are_offered_no_socket(peer):
    assert LocalListener.offer(peer, 1, 1.0) is None


def test_a_folder_for_temporary_files_with_a_long_name_leaves_grpc(tmp_path, monkeypatch):
    """The path of a Unix socket has at most 107 bytes."""
    deep = tmp_path / ("d" * 120)
    deep.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(deep))
    assert LocalListener.offer("unix:", 1, 1.0) is None
    assert not list(deep.iterdir())


def test_a_session_that_ends_before_its_client_connects_leaves_nothing_behind(tmp_path, monkeypatch):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    offered = LocalListener.offer("unix:", 1, 60.0)
    assert offered is not None
    answers = SimpleQueue[bool]()
    thread = Thread(target=lambda: answers.put(offered.accept()))
    thread.start()
    offered.end()
    assert answers.get(timeout=5.0) is False
    thread.join()
    offered.close()
    assert not list(tmp_path.iterdir())


def test_a_lost_simulator_is_lost_over_the_socket_too(tmp_path):
    with socket_that_sends(b"") as path, offering(path) as address:
        session = Session(address, "gauntlet", arenas=2, seed=0, transport="local")
        local(impatient(session))._socket.end()
        with pytest.raises(SimulatorLost):
            session.step(make_acts(session.spec, 2))
        session.close()
