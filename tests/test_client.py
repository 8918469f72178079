"""The trainer's end of a session: wherever it is called from, and whatever becomes of the other end."""

import asyncio
import signal
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from joybridge.trainer.layouts import make_acts
from joybridge.trainer.wire.client import Session, SimulatorError, SimulatorLost
from joybridge.trainer.wire.event_loop import uninterrupted
from joybridge.trainer.wire.launch import simulator_process

DECISIONS = 20


@pytest.fixture(scope="module")
def address():
    with simulator_process() as bound:
        yield bound


def played(address: str, seed: int) -> bytes:
    """Return what a session of Marble shows in some decisions at rest."""
    with Session(address, "marble", arenas=3, seed=seed) as session:
        acts = make_acts(session.spec, 3)
        return b"".join(array.tobytes() for _ in range(DECISIONS) for array in session.step(acts)[0].observations)


def test_it_works_inside_a_running_event_loop_as_in_a_notebook(address):
    async def cell() -> bytes:
        return played(address, 1)

    assert asyncio.run(cell()) == played(address, 1)


def test_sessions_in_several_threads_do_not_disturb_each_other(address):
    alone = [played(address, seed) for seed in range(4)]
    assert len(set(alone)) == 4
    with ThreadPoolExecutor(4) as pool:
        assert list(pool.map(lambda seed: played(address, seed), range(4))) == alone


def test_several_sessions_may_be_answered_at_the_same_time(address):
    with Session(address, "marble", arenas=2, seed=0) as one, Session(address, "marble", arenas=2, seed=0) as other:
        acts = make_acts(one.spec, 2)
        for _ in range(DECISIONS):
            one.send(acts)
            other.send(acts)
            for a, b in zip(other.receive()[0].observations, one.receive()[0].observations, strict=True):
                np.testing.assert_array_equal(a, b)


def test_what_is_sent_after_a_refusal_is_answered_by_it(address):
    with Session(address, "marble", arenas=2, seed=0) as session:
        acts = make_acts(session.spec, 2)
        acts[0].axes[1, 0] = 2.0
        for _ in range(2):
            with pytest.raises(SimulatorError, match=r"got 2\.0 in lane 1"):
                session.step(acts)


def test_a_session_of_a_simulator_that_went_away_is_lost_and_can_be_closed_twice():
    with simulator_process() as bound:
        session = Session(bound, "marble", arenas=2, seed=0)
    acts = make_acts(session.spec, 2)
    for _ in range(2):
        with pytest.raises(SimulatorLost):
            session.step(acts)
    session.close()
    session.close()


def test_a_closed_session_says_so(address):
    session = Session(address, "marble", arenas=2, seed=0)
    acts = make_acts(session.spec, 2)
    session.close()
    with pytest.raises(SimulatorLost, match="is closed"):
        session.step(acts)


def test_the_garbage_collector_may_close_a_session_while_another_waits(address):
    """In a program of its own, which would hang."""
    script = f"""
import gc, weakref
from joybridge.trainer.layouts import make_acts
from joybridge.trainer.wire.client import Session
from joybridge.trainer.wire.event_loop import the_loop
class Owner:
    def __init__(self):
        self.me = self  # so that only the collector frees it
        weakref.finalize(self, Session({address!r}, "marble", arenas=2, seed=0).close)
with Session({address!r}, "marble", arenas=2, seed=0) as session:
    for inside in (True, False):
        Owner()
        if inside:
            the_loop().call_soon(gc.collect)
        else:
            gc.collect()
        session.step(make_acts(session.spec, 2))
"""
    done = subprocess.run([sys.executable, "-W", "error", "-c", script], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def test_a_session_that_is_never_closed_ends_with_the_program_in_silence(address):
    script = f"""
from joybridge.trainer.layouts import make_acts
from joybridge.trainer.wire.client import Session
session = Session({address!r}, "marble", arenas=2, seed=0)
session.step(make_acts(session.spec, 2))
session.send(make_acts(session.spec, 2))
"""
    done = subprocess.run([sys.executable, "-W", "error", "-c", script], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


INTERRUPTED = """
import asyncio, random, signal
from joybridge.trainer.layouts import make_acts
from joybridge.trainer.wire.client import Session, SimulatorLost
signal.signal(signal.SIGALRM, lambda *_: signal.raise_signal(signal.SIGINT))
def play(address, begun):
    with Session(address, "marble", arenas=2, seed=0) as session:
        acts = make_acts(session.spec, 2)
        try:
            if begun:
                signal.setitimer(signal.ITIMER_REAL, 0.01 + 0.02 * random.random())
            for _ in range(50_000):
                session.step(acts)
                session.send(acts)
                session.receive()
            raise SystemExit("lost")
        except KeyboardInterrupt:
            pass
        try:
            session.send(acts)
            session.receive()
        except SimulatorLost:
            pass
def open_and_play(address):
    try:
        signal.setitimer(signal.ITIMER_REAL, 0.001 + 0.02 * random.random())
        play(address, False)
    except KeyboardInterrupt:
        pass
"""


def test_an_interrupt_is_never_lost_wherever_it_comes(address):
    script = f"""{INTERRUPTED}
for _ in range(20):
    play({address!r}, True)
    open_and_play({address!r})
"""
    done = subprocess.run([sys.executable, "-W", "error", "-c", script], capture_output=True, text=True, timeout=120)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def test_what_must_not_be_interrupted_is_not_and_all_else_is_again():
    with uninterrupted():
        signal.raise_signal(signal.SIGINT)
        signal.raise_signal(signal.SIGTERM)
    with pytest.raises(KeyboardInterrupt):
        signal.raise_signal(signal.SIGINT)


def test_an_interrupt_ends_what_waits_in_a_notebook(address):
    script = f"""{INTERRUPTED}
async def cell():
    signal.signal(signal.SIGINT, signal.default_int_handler)  # as notebooks have it
    for _ in range(10):
        play({address!r}, True)
asyncio.run(cell())
"""
    done = subprocess.run([sys.executable, "-W", "error", "-c", script], capture_output=True, text=True, timeout=120)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
