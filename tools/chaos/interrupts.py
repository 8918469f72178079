"""Ctrl-C, twice, at any moment of a training: it ends soon, without a traceback, and what is saved can be loaded."""

import random
import signal
import time
from functools import partial
from pathlib import Path

from joybridge.run.checkpoint import has_checkpoint, load_checkpoint
from tools.chaos.outcome import Outcome, percentile
from tools.chaos.process import children, wait_until
from tools.chaos.training import Training

LATEST = 8.0  # seconds after the start of the trainer, while it loads or begins
LATER = 3.0  # seconds after a checkpoint, while it trains or saves
LONGEST_END = 20.0  # seconds after the second interrupt; an idle machine needs less than one


def _has_ended(process: int) -> bool:
    return not Path(f"/proc/{process}").exists()


def interrupts(folder: Path, faults: int) -> Outcome:
    """Interrupt a training twice, so many times, every other time while it loads."""
    chance, problems, seconds, saved = random.Random(0), [], [], 0
    for number in range(faults):
        training = Training(folder / "run")
        if number % 2:
            time.sleep(chance.uniform(1.0, LATEST))
        else:
            training.wait_for_checkpoint()
            time.sleep(chance.uniform(0.0, LATER))
        left = children(training.process.pid)
        training.process.send_signal(signal.SIGINT)
        time.sleep(chance.uniform(0.0, 0.2))
        begin = time.monotonic()
        training.process.send_signal(signal.SIGINT)
        status = training.process.wait()
        seconds.append(time.monotonic() - begin)
        gone = all(wait_until(partial(_has_ended, child), 10.0) for child in left)
        if has_checkpoint(training.run):
            saved = load_checkpoint(training.run)[1].timesteps
        said = training.said()
        if status not in (130, -signal.SIGINT) or seconds[-1] > LONGEST_END or not gone or "Traceback" in said:
            problems.append(f"interrupt {number}: status {status}, {seconds[-1]:.1f} s, said {said[-300:]!r}")
    figures = f"{percentile(seconds, 0.5):.2f} s (median) to {max(seconds):.2f} s from the second to the end"
    return Outcome(faults, problems, f"{figures}, {saved:,} timesteps saved")
