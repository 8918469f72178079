"""Server processes with settings of their own, for tests that the shared simulator cannot serve."""

import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import grpc

from joybridge.client.client import Session
from joybridge.client.stream import SERVICE
from joybridge.contract.address import READY
from tests.support.wire import SECONDS

ROOT = Path(__file__).parents[2]


class Server(subprocess.Popen[str]):
    """A server process; `address` is where it says that it listens, or empty if it ended."""

    def __init__(self, *arguments, module=("-m", "joybridge.simulator"), **streams):
        free = [] if {"--address", "--port"} & {*arguments} else ["--address", "127.0.0.1:0"]  # 5005 may be in use
        command = [sys.executable, *module, "serve", *free, *arguments]
        super().__init__(command, cwd=ROOT, stdout=subprocess.PIPE, text=True, **streams)
        assert self.stdout is not None
        self.address = self.stdout.readline().removeprefix(READY).strip()


@contextmanager
def server(*arguments, **streams) -> Iterator[Server]:
    process = Server(*arguments, **streams)
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


def free_port() -> int:
    """Return a port on which nobody listens."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def impatient(session: Session, seconds: float = 0.1) -> Session:
    """Make an open session wait this long for its next answers. Opening it takes longer on a busy machine."""
    session._reader.seconds = session._reader._deadline = seconds
    return session


def end(process) -> tuple[int, str]:
    """Wait for a process to end by itself and return its exit status and what it wrote to standard error."""
    _, text = process.communicate(timeout=SECONDS)
    return process.returncode, text or ""


def refuses_to_start(*arguments, **streams) -> str:
    """Return the last line of a server that must not start."""
    with server(*arguments, stderr=subprocess.PIPE, **streams) as process:
        assert not process.address
        status, text = end(process)
    assert status == 2 and "Traceback" not in text
    return text.splitlines()[-1]


def games(*places):
    return [argument for place in places for argument in ("--game", place)]


@contextmanager
def answering_methods(**methods: Callable[..., Any]) -> Iterator[str]:
    """Yield the address of a server whose methods take and return bytes: Play a stream of them, others one message."""
    handlers = {
        name: (grpc.stream_stream_rpc_method_handler if name == "Play" else grpc.unary_unary_rpc_method_handler)(method)
        for name, method in methods.items()
    }
    with ThreadPoolExecutor(4) as pool:
        listener = grpc.server(pool)
        listener.add_generic_rpc_handlers([grpc.method_handlers_generic_handler(SERVICE, handlers)])
        port = listener.add_insecure_port("127.0.0.1:0")
        listener.start()
        yield f"127.0.0.1:{port}"
        listener.stop(None).wait()
