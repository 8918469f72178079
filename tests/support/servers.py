"""Server processes with settings of their own, for tests that the shared simulator cannot serve."""

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from joybridge.contract.address import READY
from tests.support.wire import SECONDS

ROOT = Path(__file__).parents[2]


class Server(subprocess.Popen[str]):
    """A server process; `address` is where it says that it listens, or empty if it ended."""

    def __init__(self, *arguments, **streams):
        command = [sys.executable, "-m", "joybridge.simulator", "serve", *arguments]
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
