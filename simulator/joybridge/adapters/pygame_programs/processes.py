"""The processes of a program: the first, which is started here, and its forks, which connect to the server's door."""

import atexit
import json
import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections import OrderedDict
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from select import select
from threading import RLock
from typing import Any

from joybridge.adapters.pygame_programs.settings import PygameSettings
from joybridge.adapters.pygame_programs.stacks import Stacks, place_of
from joybridge.adapters.pygame_programs.wire import BRANCH, DONE, DOOR, FIRST, FORK, OWN_FOLDER, as_json
from joybridge.adapters.settings import AdapterError
from joybridge.contract.text import printable
from joybridge.simulator.batched_game import GameError
from joybridge.simulator.workers.link import Link

MODULE = "joybridge.adapters.pygame_programs.inside"
FORK_SECONDS = 30.0  # until a forked process connects; on a busy machine it waits for its turn
ALIVE_SECONDS = 0.5  # between two looks at whether a process that has not connected is still there
END_SECONDS = 10.0  # until a process has ended whose link is closed
MAX_TEXT_CHARS = 600  # characters of what a program says of itself
MAX_BRANCHES = 256  # stems of snapshots that are kept; those not used for longest end first


class ProgramFault(Exception):
    """Where an error was raised in a program, for the server's log."""


def said(text: str) -> str:
    """Return what a program says of itself without what could move the cursor, and not too long."""
    return printable(text)[:MAX_TEXT_CHARS]


class ProgramProcesses:
    """The first process of a program, and the stems that have branched off. Sessions in several threads share them."""

    def __init__(self, settings: PygameSettings) -> None:
        """Start nothing yet."""
        self.settings = settings
        self._lock = RLock()
        self.stacks = Stacks(Path())
        self.folder = Path()  # in which every process has its own
        self._process: subprocess.Popen[bytes] | None = None
        self._stem: Link | None = None
        self._branches: OrderedDict[bytes, Link] = OrderedDict()
        self._number = 0  # of the last fork
        self._came: dict[int, Link] = {}  # forks that have connected and are not yet taken

    def start(self) -> dict[str, Any]:
        """Start the program again, and return what its first look has shown. Raises AdapterError."""
        with self._lock:
            self._forget()
            self.folder = Path(tempfile.mkdtemp(prefix="joybridge-"))
            (self.folder / "settings.json").write_bytes(as_json(self.settings.inside()))
            self.stacks = Stacks(self.folder)
            self._door = socket.socket(socket.AF_UNIX)
            self._door.bind(str(self.folder / DOOR))
            self._door.listen(1024)
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-u", "-m", MODULE, str(self.folder)],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                env=self._environment(),
                start_new_session=True,  # Ctrl-C is for the server
            )
            atexit.register(self.end)
            seconds = self.settings.number("start")
            try:
                self._stem = self._accept(0, seconds)
                kind, message = self._stem.receive(seconds)
            except (OSError, EOFError, GameError) as error:
                if not isinstance(error, TimeoutError):
                    with suppress(subprocess.TimeoutExpired):
                        self._process.wait(END_SECONDS)
                status, stack = self._process.poll(), self.stacks.take()
                self._forget(players=True)
                place = place_of(stack)
                if status in (None, -signal.SIGALRM):
                    asked = f"no frame in {seconds:g} s{place}: it has to draw and ask for input"
                    raise AdapterError(f"{asked}; start={3 * seconds:g} allows it more") from error
                fate = _signal_name(-status) if status < 0 else f"status {status}"
                above = "" if place else "; its error is above"
                raise AdapterError(f"the process has ended with {fate}{place}{above}") from ProgramFault(stack)
            shown: dict[str, Any] = json.loads(message)
            if kind != FIRST:
                self._forget(players=True)
                raise AdapterError(said(shown["text"])) from ProgramFault(shown["traceback"])
            return shown

    def fork(self, told: list[Mapping[str, Any]]) -> list[Link]:
        """Return a new player for each of what is told to them: form and seed. Raises GameError."""
        with self._lock:
            if self._process is None or self._process.poll() is not None:
                try:
                    self.start()
                except AdapterError as error:
                    raise GameError(f"the program cannot be started again: {error}") from error
            assert self._stem is not None
            return self._fork_from(self._stem, told)

    def fork_branch(self, name: bytes) -> Link | None:
        """Return a player that goes on from a branch, None if there is no such branch any more."""
        with self._lock:
            stem = self._branches.get(name)
            if stem is None:
                return None
            self._branches.move_to_end(name)
            try:
                return self._fork_from(stem, [{}])[0]
            except GameError:  # it has ended, as for lack of memory
                self._branches.pop(name).close()
                return None

    def branch(self, player: Link, name: bytes) -> None:
        """Let a player leave a stem behind that stands where it stands, if there is none of that name."""
        with self._lock:
            if name in self._branches:
                return
            self._number += 1
            try:
                player.send(BRANCH, as_json(self._number))
                stem = self._accept(self._number, FORK_SECONDS)
                kind, _ = stem.receive(FORK_SECONDS)
            except (OSError, EOFError) as error:
                raise GameError("the program could not be forked for a snapshot") from error
            assert kind == DONE, kind
            self._branches[name] = stem
            while len(self._branches) > MAX_BRANCHES:
                self._branches.popitem(last=False)[1].close()

    def forget_branches(self) -> None:
        """End the stems of all snapshots, which are then played again from the beginning of their episodes."""
        with self._lock:
            for link in self._branches.values():
                link.close()
            self._branches.clear()

    def end(self) -> None:
        """End all processes, also those that do not end when their link closes."""
        self._forget(players=True)

    def _forget(self, *, players: bool = False) -> None:
        """End the first process, and with it the stems. players: also those that play, and what they have started."""
        with self._lock:
            self.forget_branches()
            for link in self._came.values():
                link.close()
            self._came.clear()
            if self._process is not None:
                if players:
                    with suppress(ProcessLookupError):
                        os.killpg(self._process.pid, signal.SIGKILL)
                self._process.kill()
                self._process.wait()
                self._process = None
                self._door.close()
                if self._stem is not None:
                    self._stem.close()
                shutil.rmtree(self.folder, ignore_errors=True)
                atexit.unregister(self.end)

    def _environment(self) -> dict[str, str]:
        """Return that of the program: neither display nor sound card, its own home, hashes without chance."""
        kept = {name: value for name, value in os.environ.items() if not name.startswith("XDG_")}
        return kept | {
            "PYTHONPATH": _python_path(),
            "PYTHONHASHSEED": "0",
            "PYTHONDONTWRITEBYTECODE": "1",
            "PYGAME_HIDE_SUPPORT_PROMPT": "1",
            "SDL_VIDEODRIVER": "dummy",
            "SDL_AUDIODRIVER": "dummy",
            "HOME": f"{OWN_FOLDER}/home",
            "TMPDIR": f"{OWN_FOLDER}/tmp",  # noqa: S108
            "OMP_NUM_THREADS": "1",
            "OPENBLAS_NUM_THREADS": "1",  # no threads before a fork
        }

    def _fork_from(self, stem: Link, told: list[Mapping[str, Any]]) -> list[Link]:
        numbers = range(self._number + 1, self._number + 1 + len(told))
        self._number += len(told)
        try:
            for number, each in zip(numbers, told, strict=True):
                stem.send(FORK, as_json({"number": number, **each}))
            return [self._accept(number, FORK_SECONDS) for number in numbers]
        except (OSError, EOFError) as error:
            raise GameError("the program could not be forked") from error

    def _accept(self, number: int, seconds: float) -> Link:
        """Return the link of a process. Raises GameError if it does not connect."""
        limit = time.monotonic() + seconds
        while number not in self._came:
            ready, _, _ = select([self._door], [], [], ALIVE_SECONDS)
            if not ready:
                if number == 0 and self._process is not None and self._process.poll() is not None:
                    raise GameError("it has ended before it connected")
                if time.monotonic() > limit:
                    raise GameError(f"a process of the program did not connect in {seconds:g} s")
                continue
            link = Link(self._door.accept()[0])
            _, hello = link.receive(seconds)
            self._came[json.loads(hello)] = link
        return self._came.pop(number)


def _python_path() -> str:
    """Return what makes a process import from where this one does."""
    return os.pathsep.join(folder or os.curdir for folder in sys.path)


def _signal_name(number: int) -> str:
    try:
        return signal.Signals(number).name
    except ValueError:
        return f"signal {number}"


class WindowProcess(ProgramProcesses):
    """The process of a program that is played in its own window: each episode is a new one."""

    def fork(self, told: list[Mapping[str, Any]]) -> list[Link]:
        """Return the only player, whose window opens."""
        (only,) = told
        with self._lock:
            try:
                self.start()
                assert self._stem is not None
                self._stem.send(FORK, as_json(only))
            except (AdapterError, OSError) as error:
                raise GameError(f"the program cannot be played in its window: {error}") from error
            return [self._stem]

    def _environment(self) -> dict[str, str]:
        return os.environ | {"PYTHONPATH": _python_path(), "PYTHONDONTWRITEBYTECODE": "1"}
