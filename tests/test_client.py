"""Sessions from the client's side: all kinds of callers, interrupts, lost simulators."""

import asyncio
import gc
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from threading import Event

import numpy as np
import pytest

from joybridge.client import client, interruptible_loop, local_stream, stream
from joybridge.client.calls import CALL_SECONDS
from joybridge.client.client import Session, SimulatorError, SimulatorLost, Transport, describe, list_games, wait_for
from joybridge.client.errors import SimulatorShutDown
from joybridge.client.launch import simulator_process
from joybridge.contract.versions import own_version
from joybridge.layouts import make_acts
from joybridge.simulator.session import Refusal
from joybridge.v1 import bridge_pb2 as pb
from tests.support.broken_servers import AnswersTwice, BrokenServer, Gauntlet, Honest, serving
from tests.support.instructions import run_with
from tests.support.servers import answering_methods, impatient
from tools.chaos.process import open_files, wait_until
from tools.chaos.proxy import Proxy

TIMESTEPS = 20


@pytest.fixture(scope="module")
def address():
    with simulator_process() as bound:
        yield bound


def played(address: str, seed: int, timeout: float = CALL_SECONDS, transport: Transport = "auto") -> bytes:
    """Return the observations of a session of Marble without actions."""
    with Session(address, "marble", arenas=3, seed=seed, timeout=timeout, transport=transport) as session:
        acts = make_acts(session.spec, 3)
        return b"".join(array.tobytes() for _ in range(TIMESTEPS) for array in session.step(acts)[0].observations)


def test_a_session_opens_beside_one_whose_connection_swallows_every_byte(address):
    proxy = Proxy(address)
    with Session(proxy.address, "marble", arenas=3, seed=0, transport="grpc"):
        proxy.swallow()
        assert played(proxy.address, 0, 5.0, "grpc") == played(address, 0)


@pytest.mark.parametrize("transport", ["grpc", "local"])
@pytest.mark.promise("F7")
def test_closed_sessions_leave_no_connection(address, transport):
    played(address, 0, transport=transport)  # whatever is made once
    gc.disable()  # which would end what only a cycle of references keeps
    try:
        before = open_files(os.getpid())
        sessions = [Session(address, "marble", arenas=3, seed=0, transport=transport) for _ in range(40)]
        for session in sessions:
            session.close()
        del session, sessions
        assert wait_until(lambda: open_files(os.getpid()) < before + 4, 10.0)  # some of gRPC itself come and go
    finally:
        gc.enable()


def test_it_works_inside_a_running_event_loop_as_in_a_notebook(address):
    async def cell() -> bytes:
        return played(address, 1)

    assert asyncio.run(cell()) == played(address, 1)


def test_sessions_in_several_threads_do_not_disturb_each_other(address):
    alone = [played(address, seed) for seed in range(4)]
    assert len(set(alone)) == 4
    with ThreadPoolExecutor(4) as pool:
        assert list(pool.map(lambda seed: played(address, seed), range(4))) == alone


def test_several_sessions_may_wait_at_the_same_time(address):
    with Session(address, "marble", arenas=2, seed=0) as one, Session(address, "marble", arenas=2, seed=0) as other:
        acts = make_acts(one.spec, 2)
        for _ in range(TIMESTEPS):
            one.send(acts)
            other.send(acts)
            for a, b in zip(other.receive()[0].observations, one.receive()[0].observations, strict=True):
                np.testing.assert_array_equal(a, b)


def test_an_error_ends_the_session_and_is_raised_again(address):
    with Session(address, "marble", arenas=2, seed=0) as session:
        acts = make_acts(session.spec, 2)
        acts[0].axes[1, 0] = 2.0
        for _ in range(2):
            with pytest.raises(SimulatorError, match=r"got 2\.0 in lane 1") as caught:
                session.step(acts)
            assert (caught.value.reason, caught.value.field) == ("ACTION_OUT_OF_RANGE", "act.behaviors[0].axes")


def test_a_session_of_a_simulator_that_went_away_is_lost_and_can_be_closed_twice():
    with simulator_process() as bound:
        session = Session(bound, "marble", arenas=2, seed=0)
    acts = make_acts(session.spec, 2)
    for _ in range(2):
        with pytest.raises(SimulatorShutDown, match="the simulator is shutting down"):
            session.step(acts)
    session.close()
    session.close()


def test_an_error_names_a_session_that_is_closed(address):
    session = Session(address, "marble", arenas=2, seed=0)
    acts = make_acts(session.spec, 2)
    session.close()
    with pytest.raises(SimulatorLost, match="is closed"):
        session.step(acts)


def test_receive_without_send_is_an_error(address):
    with Session(address, "marble", arenas=2, seed=0) as session, pytest.raises(SimulatorError, match="without send"):
        session.receive()


@pytest.mark.promise("L4")
def test_a_wait_for_a_simulator_ends_and_names_the_command_that_starts_one():
    said: list[str] = []
    with pytest.raises(SimulatorLost, match="start one there with `joybridge serve --address"):
        wait_for("127.0.0.1:1", 1.5, said.append)
    assert said == ["waiting for a simulator at 127.0.0.1:1, 1 s more: nothing listens there"]


@contextmanager
def answering(describe: bytes | None = None, *answers: bytes) -> Iterator[str]:
    """Yield the address of a server that sends these bytes: instead of a spec, and as answers after Start.

    Then it is silent.
    """
    end = Event()
    spec = pb.DescribeGameResponse(spec=Gauntlet.describe({"size": "small"}), version=own_version()).SerializeToString()

    def play(requests, context):
        yield Honest({Gauntlet.name: Gauntlet}).answer(pb.PlayRequest.FromString(next(requests))).SerializeToString()
        for answer in answers:
            next(requests)
            yield answer
        end.wait(60.0)

    with answering_methods(DescribeGame=lambda *_: spec if describe is None else describe, Play=play) as address:
        yield address
        end.set()


@pytest.mark.promise("L2")
def test_a_simulator_that_does_not_answer_in_time_is_lost_and_the_error_says_what_was_waited_for():
    with answering() as silent, Session(silent, "gauntlet", arenas=3, first_arena=5, seed=0) as session:
        impatient(session)
        acts = make_acts(session.spec, 3)
        for _ in range(2):
            with pytest.raises(SimulatorLost) as caught:
                session.step(acts)
    assert str(caught.value).startswith(
        f"the simulator at {silent} has not answered for 0.1 s: gauntlet, arenas 5 to 7, after 0 steps, waiting "
        "for the answer to act; "
    )


@pytest.mark.parametrize("ask", [Session.save, Session.reset, lambda session: session.receive()])
@pytest.mark.promise("L2")
def test_every_wait_of_a_session_ends(ask):
    with answering() as silent, Session(silent, "gauntlet", arenas=3, seed=0) as session:
        impatient(session)
        if ask not in (Session.save, Session.reset):
            session.send(make_acts(session.spec, 3))
        with pytest.raises(
            SimulatorLost, match=r"has not answered for 0\.1 s: .* waiting for the answer to (save|reset|act)"
        ):
            ask(session)


@pytest.mark.parametrize("seconds", [1e-6, 1e-5, 1e-4])
def test_a_wait_that_ends_before_its_call_has_begun_ends(address, seconds):
    with pytest.raises(SimulatorLost, match=f"has not answered for {4 * seconds:g} s"):
        Session(address, "marble", arenas=2, seed=0, timeout=seconds)


def test_the_time_of_an_answer_begins_with_the_wait_for_it(address):
    with Session(address, "marble", arenas=2, seed=0) as session:
        acts = make_acts(session.spec, 2)
        session.step(acts)
        impatient(session, 0.5)
        session.send(acts)
        begin = time.monotonic()
        while time.monotonic() < begin + 0.6:  # learning, for example
            sum(range(1000))
        session.receive()


def test_what_is_no_message_is_an_error_that_says_so(capfd):
    with (
        answering(None, b"\xff\xff") as silly,
        Session(silly, "gauntlet", arenas=3, seed=0) as session,
        pytest.raises(SimulatorError, match="sent what is no PlayResponse: "),
    ):
        session.step(make_acts(session.spec, 3))
    with answering(b"\xff\xff") as silly, pytest.raises(SimulatorError, match="sent what is no DescribeGameResponse: "):
        describe(silly, "gauntlet", {})
    assert "Traceback" not in capfd.readouterr().err


@pytest.mark.promise("S3")
def test_a_response_that_was_not_asked_for_ends_the_session_instead_of_answering_the_next_request(monkeypatch):
    monkeypatch.setattr(stream, "PAUSE_SECONDS", -1.0)  # every call comes after a pause, however quick the machine is
    server = BrokenServer(set(), service=AnswersTwice)
    with serving(server) as address, Session(address, "gauntlet", arenas=3, seed=0) as session:
        acts = make_acts(session.spec, 3)
        acts[0].axes[:, 1] = 1.0

        def play():
            for _ in range(10_000):
                session.step(acts)

        with pytest.raises(
            SimulatorError, match=r"a response without a request \(gauntlet, arenas 0 to 2, after \d+ steps\)"
        ):
            play()


def test_what_stays_on_this_machine_takes_no_proxy(address, monkeypatch):
    with socket.socket() as bound:  # nobody listens there
        bound.bind(("127.0.0.1", 0))
        monkeypatch.setenv("http_proxy", f"http://127.0.0.1:{bound.getsockname()[1]}")
        monkeypatch.delenv("no_proxy", raising=False)
        assert "marble" in list_games(address)


def test_a_value_ends_the_distribution_of_its_parameter(address):
    size = pb.Distribution(uniform=pb.Interval(low=0.5, high=2.0))
    with Session(address, "archer", arenas=2, seed=0, distributions={"size": size}) as session:
        acts = make_acts(session.spec, 2)

        def ended():
            while not len(session.step(acts)[0].ended):
                pass
            return session.steps[0].parameters

        assert ended().shape == (2, 1)
        session.reset(parameters={"size": 1.0})
        assert ended() is None
        session.distribute({"size": size})
        session.step(acts)
        assert ended().shape == (2, 1)


class OfRevision1(Honest):
    """A server of the first revision: it refuses clients that need a newer one, and sends nothing newer."""

    @staticmethod
    def version():
        return pb.Version(product="old 1.0", revision=1)

    @staticmethod
    def look(request):
        if request.version.revision > 1:
            raise Refusal(pb.REASON_OLD_SERVER, "too new")


class GameOfRevision1(Gauntlet):
    @classmethod
    def describe(cls, options):
        spec = super().describe(options)
        spec.behaviors[0].sensors[2].ClearField("image")
        spec.behaviors[0].device.axes[1].ClearField("only_with")
        return spec


def test_a_server_of_the_first_revision_is_still_played_with():
    with serving(BrokenServer(set(), game=GameOfRevision1, session=OfRevision1)) as address:
        assert not describe(address, "gauntlet", {}).behaviors[0].sensors[2].HasField("image")
        with Session(address, "gauntlet", arenas=3, seed=0) as session:
            acts = make_acts(session.spec, 3)
            acts[0].axes[:, 1] = 1.0
            assert session.step(acts)[0].rewards.shape == (3, 2)


def test_a_session_that_nobody_refers_to_is_ended(address):
    session = Session(address, "marble", arenas=2, seed=0, transport="grpc")
    call = session._stream._call  # type: ignore[union-attr]
    del session
    played(address, 0)  # runs the event loop
    assert call.cancelled()


def run_alone(script: str) -> None:
    """Run a program that must end without output; some failures would make it hang."""
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", script],
        capture_output=True,
        text=True,
        timeout=600,
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def test_the_garbage_collector_may_close_a_session_while_the_event_loop_runs(address):
    run_alone(f"""
import gc, weakref
from joybridge.layouts import make_acts
from joybridge.client.client import Session
from joybridge.client.interruptible_loop import EVENT_LOOP
class Owner:
    def __init__(self):
        self.me = self  # so that only the garbage collector frees it
        weakref.finalize(self, Session({address!r}, "marble", arenas=2, seed=0).close)
async def collect():
    gc.collect()
with Session({address!r}, "marble", arenas=2, seed=0) as session:
    Owner()
    EVENT_LOOP.run(collect)
    session.step(make_acts(session.spec, 2))
    Owner()
    gc.collect()
    session.step(make_acts(session.spec, 2))
""")


def test_a_session_that_is_never_closed_ends_with_the_program_without_output(address):
    run_alone(f"""
from joybridge.layouts import make_acts
from joybridge.client.client import Session
session = Session({address!r}, "marble", arenas=2, seed=0)
session.step(make_acts(session.spec, 2))
session.send(make_acts(session.spec, 2))
""")


@pytest.mark.slow
@pytest.mark.parametrize(("transport", "least"), [("grpc", 50), ("local", 20)])
@pytest.mark.promise("F5")
def test_no_interrupt_is_lost_at_any_instruction_of_a_session(address, monkeypatch, transport, least):
    """A session that was interrupted goes on if it was not using the simulator; otherwise it is lost."""
    monkeypatch.setattr(stream, "PAUSE_SECONDS", -1.0)  # every call comes after a pause, however busy the machine is
    modules = (client, stream, local_stream, interruptible_loop)

    def play(session: Session) -> None:
        acts = make_acts(session.spec, 2)
        session.step(acts)
        session.send(acts)
        session.receive()

    lost = played = 0
    with Session(address, "marble", arenas=2, seed=0, transport=transport) as session:
        play(session)
        instructions = run_with(lambda: None, 0, modules, lambda: play(session), signals=True)
    assert instructions > least
    for number in range(instructions - 5):  # a little fewer if a response is there at once
        with Session(address, "marble", arenas=2, seed=0, transport=transport) as session:
            with pytest.raises(KeyboardInterrupt):
                run_with(
                    lambda: signal.raise_signal(signal.SIGINT), number, modules, lambda: play(session), signals=True
                )
            try:
                play(session)
            except SimulatorLost:
                lost += 1
            else:
                played += 1
    assert lost > 10 and played > 2


INTERRUPTED = """
import asyncio, random, signal
from joybridge.contract.versions import own_version
from joybridge.layouts import make_acts
from joybridge.client.client import Session
own_version()  # imports modules when it is first called, and an interrupt in an import is not what is tested here
signal.signal(signal.SIGALRM, lambda *_: signal.raise_signal(signal.SIGINT))
delays = random.Random(0)
def play(address, seconds):
    try:
        signal.setitimer(signal.ITIMER_REAL, delays.uniform(0.001, seconds))
        with Session(address, "marble", arenas=2, seed=0) as session:
            acts = make_acts(session.spec, 2)
            for _ in range(50_000):
                session.step(acts)
                session.send(acts)
                session.receive()
    except KeyboardInterrupt:
        return
    raise SystemExit("an interrupt was lost")
"""


def test_no_interrupt_is_lost_inside_grpc(address):
    """At random moments, most of which are in compiled code; 50,000 timesteps are its deadline."""
    run_alone(f"""{INTERRUPTED}
for _ in range(40):
    play({address!r}, 0.03)
""")


def test_no_interrupt_is_lost_in_a_notebook(address):
    run_alone(f"""{INTERRUPTED}
async def cell():
    signal.signal(signal.SIGINT, signal.default_int_handler)  # as notebooks have it
    for _ in range(20):
        play({address!r}, 0.03)
asyncio.run(cell())
""")
