"""A player that is started here: the process of a build."""

import atexit
import os
import shlex
import signal
import subprocess
import sys
from contextlib import suppress
from pathlib import Path
from threading import Thread

from joybridge.adapters.settings import AdapterError
from joybridge.adapters.unity.settings import UnitySettings

SUFFIXES = ("", ".x86_64", ".x86")  # a build on Linux may be named without its suffix, as in ML-Agents
ENDING_SECONDS = 5.0  # for a player to end after it was dismissed, and again after it was asked to


class PlayerProcess:
    """A process, which is ended with this one at the latest."""

    def __init__(self, settings: UnitySettings, port: int) -> None:
        """Start the build, which connects to `port`. Raises AdapterError."""
        command = [str(find_build(settings.place)), *(("-nographics", "-batchmode") if settings.no_graphics else ())]
        command += ["--mlagents-port", str(port)]
        if settings.logs:
            Path(settings.logs).mkdir(parents=True, exist_ok=True)
            command += ["-logFile", str(Path(settings.logs) / f"Player-{port}.log")]
        try:
            self._process = subprocess.Popen(
                [*command, *shlex.split(settings.args)],
                stdin=subprocess.DEVNULL,
                stdout=sys.stderr.fileno(),
                start_new_session=True,  # Ctrl-C is for this process, which dismisses its players
            )
        except (OSError, ValueError) as error:
            raise AdapterError(f"{settings.place} cannot be started: {error}") from error
        atexit.register(self._kill)

    def fate(self) -> str:
        """Return how the process has ended, "" while it runs."""
        status = self._process.poll()
        return "" if status is None else f"has ended with exit status {status}; see its log"

    def end(self) -> None:
        """End the process after it was dismissed. Nobody waits for it."""
        Thread(target=self._end, daemon=True).start()

    def _end(self) -> None:
        for stop in (self._terminate, self._kill):
            try:
                self._process.wait(ENDING_SECONDS)
            except subprocess.TimeoutExpired:
                stop()
        self._process.wait()
        atexit.unregister(self._kill)

    def _terminate(self) -> None:
        """Ask the process to end, and what it has started: a build may be a script that starts the player."""
        with suppress(OSError):
            if hasattr(os, "killpg"):
                os.killpg(self._process.pid, signal.SIGTERM)
            else:
                self._process.terminate()

    def _kill(self) -> None:
        """End the process, and what it has started."""
        with suppress(OSError):
            if self._process.poll() is not None:
                return
            if hasattr(os, "killpg") and hasattr(signal, "SIGKILL"):
                os.killpg(self._process.pid, signal.SIGKILL)
            else:
                self._process.kill()


def find_build(place: str) -> Path:
    """Return the file of a build. Raises AdapterError."""
    for suffix in SUFFIXES:
        path = Path(place + suffix)
        if place and path.is_file():
            return path.resolve()
    raise AdapterError(f"there is no file {place!r}; expected the path of a build, the executable file of a player")
