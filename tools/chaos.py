"""Faults on purpose: processes are killed or stopped and connections are cut, and the result must stay the same.

python -m tools.chaos                           five faults of each kind, in some minutes
python -m tools.chaos simulators --faults 50    one kind, more often
python -m tools.chaos --faults 1000             for hours

For each kind a run is trained while faults happen at random moments. A second run is trained as far without any fault.
Their last checkpoints must be equal in every bit. One line per kind tells the number of faults, how long the trainer
took from a fault to its next checkpoint, and whether the results are equal. The exit status is 1 if some are not.
"""

import argparse
import os
import random
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from joybridge.trainer.checkpoint import checkpoints, load_checkpoint
from joybridge.trainer.wire.launch import simulator_process

CONFIG = "shooting_birds/bucket-3"
SETTINGS = [
    "arenas=16", "policy.rollout_steps=60", "policy.minibatch_size=240", "checkpoint_interval=1", "timeout_seconds=3",
    "restarts=1000000",
]  # fmt: skip
LONGEST_PAUSE = 3.0  # seconds between a recovery and the next fault
DEADLINE_SECONDS = 300.0  # for the next checkpoint

Strike = Callable[["Training"], "Training"]  # does something to a training; returns the one that goes on


class Training:
    """A trainer process, with what it prints in a file beside its run."""

    def __init__(self, run: Path, *more: str) -> None:
        """Start it, or resume it if the run exists."""
        self.run, self.more = run, more
        resume = ["--resume"] if run.exists() else []
        command = [sys.executable, "-m", "joybridge", "train", CONFIG, *SETTINGS, "--run", str(run), *resume, *more]
        with run.with_suffix(".log").open("ab") as log:
            self.process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=log, stderr=log)

    def children(self) -> list[int]:
        """Return the processes that it has started: its simulator."""
        path = Path(f"/proc/{self.process.pid}/task/{self.process.pid}/children")
        return [int(text) for text in path.read_text().split()]

    def timesteps(self) -> int:
        """Return the timesteps of the newest checkpoint."""
        return max((int(folder.name) for folder in checkpoints(self.run)), default=0)

    def wait_for_checkpoint(self) -> None:
        """Wait for a new checkpoint. Raises RuntimeError if the trainer ends or none comes."""
        before, deadline = self.timesteps(), time.monotonic() + DEADLINE_SECONDS
        while self.timesteps() <= before:
            if self.process.poll() is not None or time.monotonic() > deadline:
                said = self.run.with_suffix(".log").read_text()[-500:]
                raise RuntimeError(f"no checkpoint after {before} timesteps; the trainer said: {said}")
            time.sleep(0.02)

    def end(self, number: int = signal.SIGTERM) -> None:
        """Send a signal and wait for the end."""
        self.process.send_signal(number)
        self.process.wait()


class Proxy:
    """Passes bytes between clients and a server."""

    def __init__(self, target: str) -> None:
        """Listen on a free port of this machine. target: HOST:PORT."""
        host, _, port = target.rpartition(":")
        self.target = (host, int(port))
        self.listener = socket.create_server(("127.0.0.1", 0))
        self.address = f"127.0.0.1:{self.listener.getsockname()[1]}"
        self.flowing = threading.Event()  # while it is not set, every byte is held back
        self.flowing.set()
        self.ends: list[socket.socket] = []
        threading.Thread(target=self._accept, daemon=True).start()

    def cut(self) -> None:
        """Reset all connections."""
        for end in self.ends:
            end.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            with suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)
            end.close()
        self.ends = []

    def _accept(self) -> None:
        while True:
            client, _ = self.listener.accept()
            server = socket.create_connection(self.target)
            self.ends += [client, server]
            for source, sink in ((client, server), (server, client)):
                threading.Thread(target=self._pass, args=(source, sink), daemon=True).start()

    def _pass(self, source: socket.socket, sink: socket.socket) -> None:
        with suppress(OSError):
            while data := source.recv(1 << 16):
                self.flowing.wait()
                sink.sendall(data)


def disturb(run: Path, faults: int, strike: Strike, *more: str) -> list[float]:
    """Train while `strike` happens so often, at random moments. Return the seconds from each to the next checkpoint."""
    training, seconds, moments = Training(run, *more), [], random.Random(0)
    try:
        training.wait_for_checkpoint()
        for number in range(faults):
            time.sleep(moments.uniform(0.0, LONGEST_PAUSE))
            begin = time.monotonic()
            training = strike(training)
            training.wait_for_checkpoint()
            seconds.append(time.monotonic() - begin)
            print(f"{number + 1} of {faults}: {seconds[-1]:.1f} s, {training.timesteps():,} timesteps", flush=True)
        training.end()
    finally:
        training.process.kill()
        training.process.wait()
    return seconds


def signal_simulator(number: int) -> Strike:
    """Return a fault: the trainer's own simulator gets a signal."""

    def strike(training: Training) -> Training:
        for process in training.children():
            with suppress(ProcessLookupError):
                os.kill(process, number)
        return training

    return strike


def kill_trainer(training: Training) -> Training:
    """Kill the trainer and resume its run."""
    training.end(signal.SIGKILL)
    return Training(training.run, *training.more)


def disturb_connections(run: Path, faults: int) -> list[float]:
    """Reset the connections to a simulator, or hold everything back for longer than the trainer waits."""
    with simulator_process() as address:
        proxy, kinds = Proxy(address), random.Random(1)

        def strike(training: Training) -> Training:
            if kinds.random() < 0.5:
                proxy.flowing.clear()
                time.sleep(4.0)
            proxy.cut()
            proxy.flowing.set()
            return training

        return disturb(run, faults, strike, "--simulator", proxy.address)


KINDS: dict[str, Callable[[Path, int], list[float]]] = {
    "simulators": lambda run, faults: disturb(run, faults, signal_simulator(signal.SIGKILL)),
    "stops": lambda run, faults: disturb(run, faults, signal_simulator(signal.SIGSTOP)),
    "trainers": lambda run, faults: disturb(run, faults, kill_trainer),
    "connections": disturb_connections,
}


def main() -> int:
    """Run the command line and return its exit status."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("kinds", nargs="*", help=f"any of {', '.join(KINDS)}; default all")
    parser.add_argument("--faults", type=int, default=5, help="of each kind; default %(default)s")
    options = parser.parse_args()
    if unknown := set(options.kinds) - set(KINDS):
        parser.error(f"unknown: {', '.join(sorted(unknown))}; expected any of {', '.join(KINDS)}")
    equal = True
    with tempfile.TemporaryDirectory() as folder:
        for kind in options.kinds or KINDS:
            run, straight = Path(folder, kind), Path(folder, f"{kind}-straight")
            seconds = KINDS[kind](run, options.faults)
            arrays, manifest = load_checkpoint(run)
            whole = Training(straight, f"stop={manifest.timesteps}")
            whole.process.wait()
            others, _ = load_checkpoint(straight)
            same = arrays.keys() == others.keys() and all((arrays[name] == others[name]).all() for name in arrays)
            equal &= same
            print(
                f"{kind}: {len(seconds)} faults in {manifest.timesteps:,} timesteps, {min(seconds):.1f} to "
                f"{max(seconds):.1f} s to the next checkpoint, results {'equal' if same else 'NOT EQUAL'}",
                flush=True,
            )
    return 0 if equal else 1


if __name__ == "__main__":
    sys.exit(main())
