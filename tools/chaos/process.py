"""A simulator in a process of its own, and what a process uses of the machine (Linux)."""

import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Self

from joybridge.contract.address import READY

ROOT = Path(__file__).parents[2]
DEADLINE_SECONDS = 60.0


class Simulator:
    """A `joybridge serve` on a free port of this machine; `address` is where it listens."""

    def __init__(self, *arguments: str) -> None:
        """Start it with further arguments, and wait until it listens."""
        self.log = tempfile.TemporaryFile("w+")  # noqa: SIM115  # it ends with the process
        command = [sys.executable, "-m", "joybridge", "serve", "--address", "127.0.0.1:0", *arguments]
        self.process = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=self.log, text=True)
        assert self.process.stdout is not None
        self.address = self.process.stdout.readline().removeprefix(READY).strip()

    def said(self) -> str:
        """Return what it has written to standard error."""
        self.log.seek(0)
        return self.log.read()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self.process.kill()
        self.process.communicate()
        self.log.close()


def mebibytes(process: int, line: str = "VmRSS") -> float:
    """Return the resident memory of a process, or with VmHWM its peak since `forget_peak`."""
    lines = Path(f"/proc/{process}/status").read_text().splitlines()
    return int(next(text for text in lines if text.startswith(f"{line}:")).split()[1]) / 1024


def forget_peak(process: int) -> None:
    """Let the peak of a process's memory begin at what it uses now."""
    Path(f"/proc/{process}/clear_refs").write_text("5")


def open_files(process: int) -> int:
    """Return how many files and sockets a process has open."""
    return len(list(Path(f"/proc/{process}/fd").iterdir()))


def threads(process: int) -> int:
    """Return how many threads a process has."""
    return len(list(Path(f"/proc/{process}/task").iterdir()))


def children(process: int) -> list[int]:
    """Return the processes that a process has started."""
    return [int(text) for text in Path(f"/proc/{process}/task/{process}/children").read_text().split()]


def wait_until(condition: Callable[[], bool], seconds: float = DEADLINE_SECONDS) -> bool:
    """Return whether a condition becomes true within so many seconds."""
    deadline = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > deadline:
            return False
        time.sleep(0.02)
    return True
