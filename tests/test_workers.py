"""Arenas in worker processes: the same bytes, and whatever happens to a worker is said and hurts nobody else."""

import json
import os
import signal
import socket
import threading
import time
from contextlib import closing, suppress
from dataclasses import astuple
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from joybridge.client.client import Session, SimulatorError
from joybridge.contract.codec import ActArrays, pack_act
from joybridge.simulator.batched_game import GameError
from joybridge.simulator.catalog import load_games
from joybridge.simulator.workers.link import ACT, DONE, DRAW, FAULT, OBSERVE, RESET, START, STEP, Link
from joybridge.simulator.workers.worker import Worker, work
from joybridge.v1 import bridge_pb2 as pb
from tests.support.doomed import EXIT, HANG, NOTHING, RAISE
from tests.support.servers import games, server
from tests.support.wire import SECONDS

DOOMED = "tests.support.doomed:Doomed"


def fates(*choices):
    return [ActArrays(np.empty((len(choices), 0), np.float32), np.array(choices, np.int32)[:, None])]


def parts(steps):
    """Return all arrays of a step, as bytes with their types and shapes."""
    arrays = [
        each for step in steps for field in astuple(step) for each in (field if isinstance(field, list) else [field])
    ]
    return [array if array is None else (str(array.dtype), array.shape, array.tobytes()) for array in arrays]


@pytest.mark.promise("D1")
def test_the_bytes_are_those_of_one_process_also_with_parameters_per_episode():
    place, options = "tests.support.games:Hybrid", {"size": "small", "masks": "on"}
    one: Any
    several: Any
    one, several = (load_games([place], workers)["hybrid"](options, {}, 5, 3, 2**63) for workers in (0, 3))
    random = np.random.default_rng(0)
    device = one.spec.behaviors[0].device
    with closing(several):
        assert parts(one.observe()) == parts(several.observe())
        for turn in range(30):
            if turn == 10:
                drift = pb.Distribution(uniform=pb.Interval(low=0.0, high=2.0))
                one.distributions = several.distributions = {"drift": drift}
            if turn == 20:
                one.reset(7, {})
                several.reset(7, {})
                assert parts(one.observe()) == parts(several.observe())
            masks = one.observe()[0].masks or []
            choices = np.stack([(random.random(mask.shape) * mask).argmax(1) for mask in masks], 1).astype(np.int32)
            axes = np.array(
                [[random.uniform(axis.low, axis.high) for axis in device.axes] for _ in range(5)], np.float32
            )
            step = one.step([ActArrays(axes, choices)])
            assert parts(step) == parts(several.step([ActArrays(axes, choices)]))
        assert one.draw(4).tobytes() == several.draw(4).tobytes()


def test_a_worker_answers_until_the_server_has_gone():
    mark = memoryview(bytearray(8)).cast("q")
    ours, theirs = socket.socketpair()
    link = Link(ours)
    thread = threading.Thread(target=work, args=(partial(Worker, DOOMED, mark), Link(theirs), mark))
    thread.start()
    start = {"options": {}, "parameters": {}, "arenas": 2, "first_arena": 0, "seed": 1}

    def ask(kind, message):
        link.send(kind, message if isinstance(message, bytes) else json.dumps(message).encode())
        return link.receive(SECONDS)

    def act(*choices):
        return pb.Act(behaviors=map(pack_act, fates(*choices))).SerializeToString()

    assert ask(START, start) == (DONE, b"")
    first = ask(OBSERVE, b"")
    assert ask(ACT, act(NOTHING, NOTHING))[0] == STEP
    assert ask(RESET, {"seed": 1, "parameters": {}}) == (DONE, b"")
    assert ask(OBSERVE, b"") == first
    kind, message = ask(ACT, act(NOTHING, RAISE))
    fault = json.loads(message)
    assert kind == FAULT and (fault["arena"], fault["text"]) == (1, "ValueError: as told")
    assert "doomed.py" in fault["traceback"] and mark[0] == -1
    kind, message = ask(DRAW, {"arena": 0})
    assert kind == FAULT and "no draw method" in json.loads(message)["text"]
    link.close()
    thread.join(SECONDS)
    assert not thread.is_alive()
    theirs.close()


def test_a_message_of_impossible_length_ends_the_connection():
    ours, theirs = socket.socketpair()
    with ours, theirs:
        theirs.send(b"x" * 9)
        with pytest.raises(EOFError):
            Link(ours).receive(SECONDS)


@pytest.mark.parametrize(
    ("choices", "text"),
    [
        ((0, 0, 0, RAISE), r"arena 3: ValueError: as told, in worker 1 \(arenas 2 to 3\)"),
        ((0, EXIT, 0, 0), r"arena 1: worker 0 \(arenas 0 to 1\) ended with exit status 7"),
        ((0, 0, HANG, 0), r"arena 2: worker 1 \(arenas 2 to 3\) gave no result in 0.5 s; .* --step-seconds"),
    ],
)
@pytest.mark.promise("F3")
def test_what_becomes_of_a_worker_is_said_with_the_arena(choices, text, capfd):
    game: Any = load_games([DOOMED], 2)["doomed"]({}, {}, 4, 0, 1)
    with closing(game):
        game.step(fates(0, 0, 0, 0))
        for process in game.processes:
            process.seconds = 0.5 if HANG in choices else SECONDS
        with pytest.raises(GameError, match=text):
            game.step(fates(*choices))
    if HANG in choices:  # its stack is in the log
        assert "doomed.py" in capfd.readouterr().err


def test_a_session_whose_worker_dies_ends_alone_and_nothing_outlives_the_server():
    text = r"doomed failed in step 1: arena 2: worker 1 \(arenas 2 to 2\)"
    with (
        server("--address", "127.0.0.1:0", "--workers", "2", *games(DOOMED)) as process,
        Session(process.address, "doomed", arenas=3, seed=1) as other,
    ):
        workers = children(process.pid)
        assert len(workers) == 2
        with Session(process.address, "doomed", arenas=3, seed=1) as unlucky, pytest.raises(SimulatorError, match=text):
            unlucky.step(fates(NOTHING, NOTHING, EXIT))
        other.step(fates(NOTHING, NOTHING, NOTHING))
        until(lambda: children(process.pid) == workers)
        other.send(fates(NOTHING, HANG, NOTHING))
        process.kill()
        process.wait()
        until(lambda: not any(map(alive, workers)))


@pytest.mark.parametrize(("workers", "stubborn"), [("1", "false"), ("2", "false"), ("2", "true")])
@pytest.mark.promise("X7")
def test_what_environments_hold_ends_with_the_session_and_with_the_server(workers, stubborn, tmp_path):
    place = f"tests.support.environments:Holding-v0 folder={tmp_path} stubborn={stubborn}"

    def held():
        return [file.name for file in tmp_path.iterdir() if alive(file.name)]

    with server("--address", "127.0.0.1:0", "--workers", workers, "--gym", place) as process:
        looking = held()  # what the environment that was looked at has failed to end
        with Session(process.address, "Holding-v0", arenas=3, seed=1) as session:
            assert len(held()) == 3 + len(looking) * 3
            session.step([ActArrays(np.empty((3, 0), np.float32), np.zeros((3, 1), np.int32))])
        until(lambda: held() == looking)
        with Session(process.address, "Holding-v0", arenas=3, seed=1):
            assert len(held()) > len(looking)
            process.send_signal(signal.SIGTERM if workers == "1" else signal.SIGKILL)
            process.wait()
            until(lambda: held() == looking)
    for pid in looking:
        os.kill(int(pid), signal.SIGKILL)


HASTY = """
import sys
import grpc.aio._server

async def stop(self, grace):
    pass

grpc.aio._server.Server.stop = stop
from joybridge.simulator.__main__ import main
sys.exit(main(sys.argv[1:]))
"""


def test_what_environments_hold_ends_also_where_grpc_ends_before_the_session(tmp_path):
    """gRPC may say that all calls are over before the coroutine of a session has run its `finally`."""
    place = f"tests.support.environments:Holding-v0 folder={tmp_path}"
    with (
        server("--workers", "1", "--gym", place, module=("-c", HASTY)) as process,
        Session(process.address, "Holding-v0", arenas=3, seed=1),
    ):
        process.send_signal(signal.SIGTERM)
        process.wait()
        held = [file.name for file in tmp_path.iterdir()]
        assert len(held) > 3  # some were looked at before
        until(lambda: not any(map(alive, held)))


def test_a_worker_that_takes_no_message_is_too_slow():
    game: Any = load_games([DOOMED], 2)["doomed"]({}, {}, 2, 0, 1)
    with closing(game):
        process = game.processes[0]
        process.seconds = 0.2
        os.kill(process._process.pid, signal.SIGSTOP)
        with pytest.raises(GameError, match=r"worker 0 \(arenas 0 to 0\) gave no result in 0.2 s"):
            process.send(ACT, bytes(1 << 24))


def children(pid):
    """Return the processes that a process has started."""
    found = set()
    for task in Path(f"/proc/{pid}/task").iterdir():
        with suppress(FileNotFoundError):  # the thread has ended
            found.update((task / "children").read_text().split())
    return found


def alive(pid):
    """Return whether a process runs; a zombie does not."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def until(condition):
    """Wait until something is so."""
    limit = time.monotonic() + SECONDS
    while not condition():
        assert time.monotonic() < limit
        os.sched_yield()
