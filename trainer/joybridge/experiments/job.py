"""One training run of a grid: its configuration, its folder, and the trainer process that makes it."""

import os
import signal
import subprocess
import sys
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Protocol

from joybridge.experiments.names import RunName
from joybridge.trainer.checkpoint import has_checkpoint, load_checkpoint
from joybridge.trainer.config import changes, load_config, run_config
from joybridge.trainer.errors import CheckpointError, ConfigError
from joybridge.trainer.metrics import read_rows


@dataclass(frozen=True)
class Job:
    """One training run: a configuration, a seed and a number of timesteps. Raises ValueError, see `RunName`."""

    experiment: str  # a configuration's path below `configs`, without ".yaml"
    seed: int
    timesteps: int
    configs: Path  # folder of configurations
    runs: Path  # folder of all runs
    overrides: tuple[str, ...] = ()  # of the configuration, each KEY=VALUE

    def __post_init__(self) -> None:
        """Check the experiment's name."""
        RunName(self.experiment, self.seed)

    @property
    def name(self) -> RunName:
        """Return the run's name."""
        return RunName(self.experiment, self.seed)

    @property
    def config(self) -> Path:
        """Return the file of the configuration."""
        return self.configs / f"{self.experiment}.yaml"

    @property
    def run(self) -> Path:
        """Return the run's folder."""
        return self.runs / str(self.name)

    def done(self) -> int:
        """Return the timesteps of the last row of metrics, at most those of the job."""
        rows = [row for path in self.run.glob("metrics-*.csv") for row in read_rows(path)[-1:]]
        return min(self.timesteps, max((int(row["timesteps"]) for row in rows), default=0))

    def finished(self) -> bool:
        """Return whether the run has reached its number of timesteps with the configuration as it is now."""
        try:
            config = load_config(self.config, self.settings())
            if not has_checkpoint(self.run) or load_checkpoint(self.run)[1].timesteps < config.end:
                return False
            return not changes(run_config(self.run), config)
        except (CheckpointError, ConfigError):  # the trainer reports the same error when the job is started
            return False

    def settings(self) -> list[str]:
        """Return everything that differs from the configuration, each KEY=VALUE."""
        return [*self.overrides, f"seed={self.seed}", f"stop={self.timesteps}"]

    def command(self, config: Path, run: Path) -> list[str]:
        """Return the command that starts the run in the folder `run`, or resumes it.

        The command's standard input must be `lifeline()`.
        """
        resume = ["--resume"] if has_checkpoint(run) else []
        trainer = [sys.executable, "-m", "joybridge.trainer", "train", "--with-parent"]
        return [*trainer, str(config), "--run", str(run), *self.settings(), *resume]

    def failure(self, status: int) -> str:
        """Return why the run failed: the signal that killed it, or the last line of its log."""
        if status < 0:
            return f"killed by {signal.Signals(-status).name}"
        log = self.run / "log.txt"
        lines = log.read_text(errors="replace").split("\n") if log.exists() else []
        return next((line.strip() for line in reversed(lines) if line.strip()), f"exit status {status}, empty log.txt")


class Process(Protocol):
    """A started run: the part of `subprocess.Popen` that a grid needs."""

    def poll(self) -> int | None:
        """Return the exit status, or None while the run is going on."""

    def terminate(self) -> None:
        """Ask the run to save a checkpoint and end."""

    def wait(self) -> int:
        """Wait for the end and return the exit status."""


def start(job: Job) -> Process:
    """Start or resume a run as a process on this machine, with its output in log.txt in the run's folder.

    If another process is training the run, the new one ends with an error.
    """
    job.run.mkdir(parents=True, exist_ok=True)
    with (job.run / "log.txt").open("ab") as log:
        return subprocess.Popen(
            job.command(job.config, job.run), stdin=lifeline(), stdout=log, stderr=subprocess.STDOUT
        )


@cache
def lifeline() -> int:
    """Return the read end of a pipe that closes when this process ends, even if it is killed.

    A trainer that has it as standard input saves a checkpoint and ends when it closes.
    """
    return os.pipe()[0]
