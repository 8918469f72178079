"""The server's view of a worker: it starts it, asks it, and says what has become of it."""

import json
import mmap
import os
import signal
import socket
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from contextlib import suppress
from math import isinf
from typing import Any

from joybridge.simulator.batched_game import ArenaError, GameError
from joybridge.simulator.workers.link import CLOSING_SECONDS, FAULT, Link

MODULE = "joybridge.simulator.workers.worker"
ENDING_SECONDS = 1.0  # to write a stack into the log
NONE = -1  # no arena is played


class WorkerTraceback(Exception):
    """Where an error was raised in a worker, for the server's log."""


class WorkerProcess:
    """A worker with some arenas of a session."""

    def __init__(self, place: str, number: int, arenas: range, seconds: float) -> None:
        """Start a worker. seconds: for each answer. Raises OSError."""
        self.arenas, self.seconds = arenas, seconds
        self._name = f"worker {number} (arenas {arenas.start} to {arenas.stop - 1})"
        ours, theirs = socket.socketpair()
        with theirs, tempfile.TemporaryFile() as file:
            file.write(NONE.to_bytes(8, sys.byteorder, signed=True))
            file.flush()
            self._mark = memoryview(mmap.mmap(file.fileno(), 0)).cast("q")
            descriptors = (theirs.fileno(), file.fileno())
            # -P and PYTHONPATH: it imports from where this process does.
            folders = {"PYTHONPATH": os.pathsep.join(folder or os.curdir for folder in sys.path)}
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-u", "-m", MODULE, place, *map(str, descriptors)],
                stdin=subprocess.PIPE,
                pass_fds=descriptors,
                env=os.environ | folders,
                start_new_session=True,  # Ctrl-C is for the server
            )
        self._link = Link(ours)

    def send(self, kind: bytes, message: bytes | Mapping[str, Any]) -> None:
        """Send a frame. Raises GameError if the worker has ended or does not take it."""
        data = message if isinstance(message, bytes) else json.dumps(message).encode()
        try:
            self._link.send(kind, data, None if isinf(self.seconds) else self.seconds)
        except TimeoutError:
            raise self._too_slow() from None
        except OSError as error:
            raise self._ended() from error

    def receive(self) -> bytes:
        """Return the message of the answer. Raises GameError, which names the arena where it is known."""
        try:
            kind, message = self._link.receive(self.seconds)
        except TimeoutError:
            raise self._too_slow() from None
        except (EOFError, OSError) as error:
            raise self._ended() from error
        if kind == FAULT:
            fault = json.loads(message)
            text = f"{fault['text']}, in {self._name}"
            raise self._error(fault["arena"], text) from WorkerTraceback(fault["traceback"])
        return message

    def let_go(self) -> None:
        """Let the worker close its games and end."""
        assert self._process.stdin is not None
        self._process.stdin.close()
        self._link.close()

    def end(self) -> None:
        """End the process, wherever it is, and all that its games have started."""
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(CLOSING_SECONDS)
        with suppress(ProcessLookupError):
            os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()

    def _error(self, arena: int, text: str) -> GameError:
        return GameError(text) if arena == NONE else ArenaError(self.arenas[arena], text)

    def _ended(self) -> GameError:
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(ENDING_SECONDS)
        status = self._process.returncode
        return self._error(self._mark[0], f"{self._name} ended with exit status {status}; see the server's log")

    def _too_slow(self) -> GameError:
        arena = self._mark[0]
        self._process.send_signal(signal.SIGABRT)
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(ENDING_SECONDS)
        text = f"{self._name} gave no result in {self.seconds:g} s; its stack is in the server's log; a game that "
        return self._error(arena, f"{text}needs more time is served with --step-seconds")
