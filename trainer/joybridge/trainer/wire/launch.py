"""Start a simulator as a process of one's own, and always end it."""

import os
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from threading import Thread

from joybridge.trainer.wire.client import SimulatorLost

ENDING_SECONDS = 5.0
READY = "joybridge simulator listening on "


@contextmanager
def simulator_process(games: Sequence[str] = ()) -> Iterator[str]:
    """Run `joybridge serve` on a free loopback port and yield its address.

    games: further games as "module:Class". The process is ended on leaving, however that happens; should
    this process be killed, the simulator ends by itself (see --with-parent). What games print goes to
    standard error. Raises SimulatorLost if it does not start.
    """
    command = [sys.executable, "-u", "-m", "joybridge.simulator", "serve", "--address", "127.0.0.1:0", "--with-parent"]
    for game in games:
        command += ["--game", game]
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=os.environ)
    rest: Thread | None = None
    try:
        assert process.stdout is not None
        for line in process.stdout:
            if line.startswith(READY):
                break
            sys.stderr.write(line)
        else:
            raise SimulatorLost(f"the simulator did not start (exit status {process.wait()}); its message is above")
        rest = Thread(target=sys.stderr.writelines, args=(process.stdout,), daemon=True)  # line by line
        rest.start()  # else a game that prints would wait for ever once the pipe is full
        yield line.removeprefix(READY).strip()
    finally:
        process.terminate()
        try:
            process.wait(ENDING_SECONDS)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        if rest is not None:
            rest.join(ENDING_SECONDS)  # or a process of the game lives on with the pipe
        for pipe in (process.stdin, process.stdout):
            if pipe is not None:
                pipe.close()
