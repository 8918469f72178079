"""Start a simulator as a process of one's own, and always end it."""

import os
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from trainer.client import SimulatorLost

ENDING_SECONDS = 5.0


@contextmanager
def simulator_process(games: Sequence[str] = ()) -> Iterator[str]:
    """Run `python -m simulator serve` on a free loopback port and yield its address.

    games: further games as "module:Class". The process is ended on leaving, however that happens; should
    this process be killed, the simulator ends by itself (see --with-parent). Raises SimulatorLost if it
    does not start.
    """
    command = [sys.executable, "-m", "simulator", "serve", "--address", "127.0.0.1:0", "--with-parent"]
    for game in games:
        command += ["--game", game]
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=os.environ)
    try:
        assert process.stdout is not None
        line = process.stdout.readline()
        if not line:
            raise SimulatorLost(f"the simulator did not start (exit status {process.wait()}); its message is above")
        yield line.split()[-1]
    finally:
        process.terminate()
        try:
            process.wait(ENDING_SECONDS)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        for pipe in (process.stdin, process.stdout):
            if pipe is not None:
                pipe.close()
