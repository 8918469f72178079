"""Faults during training: processes are killed or stopped, connections are cut, and the result must stay the same.

A run is trained while faults happen at random moments. A second run is trained as far without any fault. Their last
checkpoints must be equal in every bit.
"""

import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from joybridge.client.launch import simulator_process
from joybridge.run.checkpoint import checkpoints, load_checkpoint
from tools.chaos.outcome import Outcome
from tools.chaos.process import children
from tools.chaos.proxy import Proxy

CONFIG = "shooting_birds/bucket-3"
SETTINGS = [
    "arenas=16",
    "policy.rollout_steps=60",
    "policy.minibatch_size=240",
    "checkpoint_interval=1",
    "timeout_seconds=3",
    "max_restarts=1000000",
]
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

    def said(self) -> str:
        """Return what it has printed."""
        return self.run.with_suffix(".log").read_text()

    def timesteps(self) -> int:
        """Return the timesteps of the newest checkpoint."""
        return max((int(folder.name) for folder in checkpoints(self.run)), default=0)

    def wait_for_checkpoint(self) -> None:
        """Wait for a new checkpoint. Raises RuntimeError if the trainer ends or none comes."""
        before, deadline = self.timesteps(), time.monotonic() + DEADLINE_SECONDS
        while self.timesteps() <= before:
            if self.process.poll() is not None or time.monotonic() > deadline:
                raise RuntimeError(f"no checkpoint after {before} timesteps; the trainer said: {self.said()[-500:]}")
            time.sleep(0.02)

    def end(self, number: int = signal.SIGTERM) -> None:
        """Send a signal and wait for the end."""
        self.process.send_signal(number)
        self.process.wait()


def disturb(folder: Path, faults: int, strike: Strike, *more: str) -> Outcome:
    """Train while `strike` happens so often, at random moments, and compare with a run without faults."""
    training, seconds, moments = Training(folder / "run", *more), [], random.Random(0)
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
    arrays, manifest = load_checkpoint(training.run)
    whole = Training(folder / "straight", f"stop_at={manifest.timesteps}")
    whole.process.wait()
    others, _ = load_checkpoint(whole.run)
    same = arrays.keys() == others.keys() and all((arrays[name] == others[name]).all() for name in arrays)
    figures = (
        f"{min(seconds):.1f} to {max(seconds):.1f} s from a fault to the next checkpoint, {manifest.timesteps:,} "
        f"timesteps, results {'equal' if same else 'NOT EQUAL'}"
    )
    return Outcome(faults, [] if same else ["the results are not those of a run without faults"], figures)


def simulators(folder: Path, faults: int) -> Outcome:
    """Kill the trainer's own simulator."""
    return disturb(folder, faults, _signal_simulator(signal.SIGKILL))


def stops(folder: Path, faults: int) -> Outcome:
    """Stop the trainer's own simulator for ever."""
    return disturb(folder, faults, _signal_simulator(signal.SIGSTOP))


def trainers(folder: Path, faults: int) -> Outcome:
    """Kill the trainer and resume its run."""

    def strike(training: Training) -> Training:
        training.end(signal.SIGKILL)
        return Training(training.run, *training.more)

    return disturb(folder, faults, strike)


def freezes(folder: Path, faults: int) -> Outcome:
    """Stop the trainer for some seconds, longer than it waits for an answer, and let it go on."""

    def strike(training: Training) -> Training:
        training.process.send_signal(signal.SIGSTOP)
        time.sleep(4.0)
        training.process.send_signal(signal.SIGCONT)
        return training

    return disturb(folder, faults, strike)


def connections(folder: Path, faults: int) -> Outcome:
    """Reset the connections to a simulator, hold all bytes back, or swallow them."""
    with simulator_process() as address:
        proxy, kinds = Proxy(address), random.Random(1)

        def strike(training: Training) -> Training:
            match kinds.choice(["cut", "hold", "swallow"]):
                case "cut":
                    proxy.cut()
                case "hold":
                    proxy.flowing.clear()
                    time.sleep(4.0)
                    proxy.cut()
                    proxy.flowing.set()
                case _:
                    proxy.swallow()
            return training

        return disturb(folder, faults, strike, "--simulator", proxy.address, "transport=grpc")


def _signal_simulator(number: int) -> Strike:
    """Return a fault: the trainer's own simulator gets a signal."""

    def strike(training: Training) -> Training:
        for process in children(training.process.pid):
            with suppress(ProcessLookupError):
                os.kill(process, number)
        return training

    return strike
