"""What a simulator's log says of mistakes, and what it does not say again."""

import logging
import subprocess
import sys

import numpy as np

from joybridge.contract.codec import pack
from joybridge.simulator.log import TRACEBACKS, Lines
from joybridge.v1 import bridge_pb2 as pb
from tests.support.servers import end, games, server
from tests.support.wire import Stream, act, start

PRESS = act(pb.BehaviorAct(choices=pack(np.ones((2, 1), np.int32))))


def shown(lines: Lines, text: str) -> str:
    """Return what a log shows of an error with a text."""
    try:
        raise ValueError(text)
    except ValueError:
        record = logging.LogRecord("log", logging.ERROR, "", 0, "it failed", None, sys.exc_info())
    return lines.format(record)


def test_a_mistake_that_ends_every_session_shows_its_traceback_once():
    arguments = ["--address", "127.0.0.1:0", *games("tests.support.games:Raises")]
    with server(*arguments, stderr=subprocess.PIPE) as process:
        for _ in range(3):
            with Stream(process.address) as stream:
                for request in (start("raises"), PRESS, PRESS):
                    stream.ask(request)
                stream.refusal(PRESS)
        process.terminate()
        status, text = end(process)
    assert status == 0
    assert text.count("raises failed in step 3: arena 0: ZeroDivisionError: division by zero\n") == 3
    assert text.count("Traceback") == 1 and text.count("return transition({") == 1
    assert text.count("(the traceback is that of ") == 2
    assert "session.py" not in text  # how the server called the game says nothing about the mistake


def test_tracebacks_that_differ_are_shown_each_and_the_oldest_are_forgotten():
    lines = Lines("%(message)s")
    assert shown(lines, "0").startswith("it failed\n  Traceback")
    assert shown(lines, "0").startswith("it failed\n  (the traceback is that of ")
    for number in range(TRACEBACKS):
        assert "Traceback" in shown(lines, f"{number + 1}")
    assert "Traceback" in shown(lines, "0")
