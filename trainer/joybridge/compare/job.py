"""One training run of a grid: its configuration, its folder, and the trainer process that makes it."""

import os
import shutil
import signal
import subprocess
import sys
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Protocol

from joybridge.compare.names import RunName
from joybridge.config.config import load_config
from joybridge.config.errors import CheckpointError, ConfigError
from joybridge.config.files import storing
from joybridge.config.metrics import Row, read_rows
from joybridge.run.checkpoint import has_checkpoint, load_checkpoint
from joybridge.run.folder import changes, run_config
from joybridge.run.run_lock import PARENT_SECONDS, locked


@dataclass(frozen=True)
class Job:
    """One training run: a configuration, a seed and a number of timesteps. Raises ValueError, see `RunName`."""

    experiment: str  # a configuration's path below `configs`, without ".yaml"
    seed: int
    timesteps: int
    configs: Path  # folder of configurations
    runs: Path  # folder of all runs
    overrides: tuple[str, ...] = ()  # of the configuration, each KEY=VALUE
    arguments: tuple[str, ...] = ()  # of `train`, for example --simulator ADDRESS
    exact: bool = True  # a resumed run has the same results; otherwise an interrupted run starts over

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

    def last_row(self) -> Row:
        """Return the last row of metrics of the run's last policy, which has the buttons; empty if there is none.

        Metrics that cannot be read are reported by the trainer when it is started, and when they are kept.
        """
        for path in sorted(self.run.glob("metrics-*.csv"))[-1:]:
            with suppress(CheckpointError):
                return next(reversed(read_rows(path)), {})
        return {}

    def finished(self) -> bool:
        """Return whether the run has reached its number of timesteps with the configuration as it is now."""
        try:
            config = load_config(self.config, self.settings())
            if not has_checkpoint(self.run) or load_checkpoint(self.run)[1].timesteps < config.end:
                return False
            return not changes(run_config(self.run), config)
        except (CheckpointError, ConfigError):  # the trainer reports the same error when the job is started
            return False

    def prepare(self) -> None:
        """Wait for the trainer of a grid that was killed, and delete what it left if this cannot be resumed exactly.

        A run of another configuration is left alone: the trainer refuses to resume it. Raises ConfigError and
        StorageError, and RunLockedError while another process is training the run.
        """
        with locked(self.run, PARENT_SECONDS):
            if self.exact or not has_checkpoint(self.run):
                return
            if changes(run_config(self.run), load_config(self.config, self.settings())):
                return
            with storing(self.run):
                shutil.rmtree(self.run / "tensorboard", ignore_errors=True)
                for path in self.run.glob("metrics-*.csv"):
                    path.unlink()
                shutil.rmtree(self.run / "checkpoints")  # last: without it, nothing would be known to be left

    def settings(self) -> list[str]:
        """Return everything that differs from the configuration, each KEY=VALUE."""
        return [*self.overrides, f"seed={self.seed}", f"stop_at={self.timesteps}"]

    def command(self, config: Path, run: Path) -> list[str]:
        """Return the command that starts the run in the folder `run`, or resumes it.

        The command's standard input must be `lifeline()`.
        """
        resume = ["--resume"] if has_checkpoint(run) else []
        trainer = [sys.executable, "-m", "joybridge", "train", "--with-parent"]
        return [*trainer, str(config), "--run", str(run), *self.arguments, *self.settings(), *resume]

    def failure(self, status: int) -> str:
        """Return why the run failed: the signal that killed it, or the last line of its log."""
        if status < 0:
            return f"killed by {signal.Signals(-status).name}"
        log = self.run / "log.txt"
        lines = log.read_text(errors="replace").split("\n") if log.exists() else []
        return next((line.strip() for line in reversed(lines) if line.strip()), f"exit status {status}, empty log.txt")


@dataclass(frozen=True)
class PeerJob(Job):
    """A training run by another trainer, which always starts from the beginning. arguments: of its command."""

    def finished(self) -> bool:
        """Return whether the run has ended with the configuration as it is now."""
        try:
            before, now = run_config(self.run), load_config(self.config, self.settings())
        except ConfigError:
            return False
        return before.stop_at == now.stop_at and not changes(before, now)

    def prepare(self) -> None:
        """Do nothing: nothing is left that could be resumed, or that another process could still be writing."""

    def command(self, config: Path, run: Path) -> list[str]:
        """Return the command that starts the run."""
        trainer = [sys.executable, "-m", "joybridge.compare.sb3"]
        return [*trainer, str(config), "--run", str(run), *self.arguments, *self.settings()]


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
