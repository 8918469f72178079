"""Start simulators as child processes, and always end them."""

import os
import subprocess
import sys
import sysconfig
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from threading import Thread, Timer

from joybridge.client.errors import SimulatorLost
from joybridge.contract.address import READY
from joybridge.progress import SILENCE_SECONDS, say

__all__ = ["announcing", "simulator_process"]

ENDING_SECONDS = 5.0
WAITING = "waiting for a simulator that was started to be ready; on a busy machine it takes longer"
LOST_SECONDS = 0.5  # the same after an error or an interrupt: perhaps it no longer listens to anything
# -P: a folder joybridge/ or a file tools.py in the current folder is not imported in place of the installed modules.
# -u: what games print appears at once.
COMMAND = [sys.executable, "-P", "-u", "-m", "joybridge", "serve"]


@contextmanager
def simulator_process(
    games: Sequence[str] = (), address: str = "127.0.0.1:0", protection: Sequence[str] = ()
) -> Iterator[str]:
    """Run `joybridge serve`, by default on a free loopback port, and yield its address.

    games: further games as MODULE:CLASS, which are searched where this process imports from. protection: options of
    `serve` for TLS and the token, which addresses beyond loopback need. What the simulator and its games print goes to
    standard error. The process ends with the block, or with this process if that is killed (see --with-parent). Raises
    SimulatorLost if it does not start, for example because the extra `simulator` is not installed.
    """
    command = [*COMMAND, "--address", address, "--with-parent", *protection]
    for game in games:
        command += ["--game", game]
    if find_spec("numba") is None:
        raise SimulatorLost(
            "a simulator cannot be started here because its games are not installed; install them with "
            "`pip install 'joybridge[simulator]'`, or give the address of a running simulator"
        )
    folders = {"PYTHONPATH": os.pathsep.join(_folders_of_others())} if games else {}
    with announcing(command, "the simulator did not start: ", folders) as bound:
        yield bound


@contextmanager
def announcing(command: Sequence[str], failure: str, environment: Mapping[str, str] | None = None) -> Iterator[str]:
    """Run a program until the block ends, and yield what follows READY in the line with which it says that it is ready.

    It is asked to end by SIGTERM, and by the end of its standard input, which comes even if this process is killed.
    Raises SimulatorLost, `failure` and its last line, if it ends before it is ready.
    """
    process = subprocess.Popen(
        command,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        errors="replace",  # a game may print anything
        env={**os.environ, **(environment or {})},
        start_new_session=True,  # Ctrl-C and the end of a terminal are for this process
    )
    printer: Thread | None = None
    patience = LOST_SECONDS
    waiting = Timer(SILENCE_SECONDS, say, [WAITING])
    waiting.daemon = True
    waiting.start()
    try:
        assert process.stdout is not None
        last_line, held = "", ""
        for line in process.stdout:
            sys.stderr.write(held)
            held = ""
            if line.startswith(READY):
                break
            if line.startswith("error: "):
                held = line  # as the last line, it is the reason in the exception
            else:
                sys.stderr.write(line)
            last_line = line.strip() or last_line
        else:
            reason = last_line.removeprefix("error: ") or f"exit status {process.wait()}"
            raise SimulatorLost(failure + reason)
        waiting.cancel()
        # Without a reader, a game that prints would block once the pipe is full.
        printer = Thread(target=sys.stderr.writelines, args=(process.stdout,), daemon=True)
        printer.start()
        yield line.removeprefix(READY).strip()
        patience = ENDING_SECONDS
    finally:
        waiting.cancel()
        process.terminate()
        try:
            process.wait(patience)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        if process.stdin is not None:
            process.stdin.close()
        if printer is not None:
            printer.join(ENDING_SECONDS)
        # A child process of a game may hold the pipe open; closing it would then wait for the thread that reads it.
        if process.stdout is not None and (printer is None or not printer.is_alive()):
            process.stdout.close()


def _folders_of_others() -> list[str]:
    """Return the folders that this process imports from, without those of Python itself.

    A game may start programs that run under another Python, such as a build of Unity that is a script.
    """
    own = [Path(sysconfig.get_path(name)) for name in ("stdlib", "purelib", "platlib")]
    return [
        folder or os.curdir
        for folder in sys.path
        if not folder.endswith(".zip") and not any(Path(folder).is_relative_to(one) for one in own)
    ]
