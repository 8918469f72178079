"""A grid of training runs: each a process, started, watched, and gone on with where it stopped."""

import fcntl
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Protocol

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from joybridge.trainer.checkpoint import CheckpointError, has_checkpoint, load_checkpoint
from joybridge.trainer.config import ConfigError, changes, load_config
from joybridge.trainer.metrics import read_rows

POLL_SECONDS = 0.5
GRACE_SECONDS = 10.0


@dataclass(frozen=True)
class Job:
    """One training run of the grid."""

    experiment: str  # a configuration's path under `configs`, without ".yaml"
    seed: int
    timesteps: int
    configs: Path  # folder of configurations
    runs: Path  # folder of all runs
    overrides: tuple[str, ...] = ()  # of the configuration, each KEY=VALUE

    @property
    def name(self) -> str:
        """Return what the run is called."""
        return f"{self.experiment} s{self.seed}"

    @property
    def config(self) -> Path:
        """Return its configuration."""
        return self.configs / f"{self.experiment}.yaml"

    @property
    def run(self) -> Path:
        """Return the run's folder."""
        return self.runs / f"{self.experiment}-s{self.seed}"

    def done(self) -> int:
        """Return the timesteps of the last row of metrics."""
        rows = [row for path in self.run.glob("metrics-*.csv") for row in read_rows(path)[-1:]]
        return min(self.timesteps, max((int(row["timesteps"]) for row in rows), default=0))

    def finished(self) -> bool:
        """Return whether the run has reached its end, configured as it is now."""
        try:
            if not has_checkpoint(self.run) or load_checkpoint(self.run)[1]["timesteps"] < self.timesteps:
                return False
            return not changes(load_config(self.run / "config.yaml"), load_config(self.config, self.settings()))
        except (CheckpointError, ConfigError):  # the trainer will say what is wrong with it
            return False

    def kept(self, results: Path) -> list[Path]:
        """Return the files that a finished run has left in `results`, one per policy."""
        folder = results / f"{self.timesteps / 1e6:g}M"
        return [path for end in ("", "-*") for path in folder.glob(f"{self.experiment}-s{self.seed}{end}.csv")]

    def settings(self) -> list[str]:
        """Return all that differs from the configuration."""
        return [*self.overrides, f"seed={self.seed}", f"stop={self.timesteps}"]

    def command(self, config: Path, run: Path) -> list[str]:
        """Return the trainer's command that begins or goes on with the run in the folder `run`.

        Its standard input must be `lifeline()`.
        """
        resume = ["--resume"] if has_checkpoint(run) else []
        trainer = [sys.executable, "-m", "joybridge.trainer", "train", "--with-parent"]
        return [*trainer, str(config), "--run", str(run), *self.settings(), *resume]

    def complaint(self, status: int) -> str:
        """Return why it failed: the signal that killed it, or the last line of its log."""
        if status < 0:
            return f"killed by {signal.Signals(-status).name}"
        log = self.run / "log.txt"
        lines = log.read_text(errors="replace").split("\n") if log.exists() else []
        return next((line.strip() for line in reversed(lines) if line.strip()), "it said nothing")


class Process(Protocol):
    """A run that goes on somewhere; like `subprocess.Popen`."""

    def poll(self) -> int | None:
        """Return the exit status, or None while it runs."""

    def terminate(self) -> None:
        """Ask it to save and end."""

    def wait(self) -> int:
        """Wait for the exit status."""


def start(job: Job) -> Process:
    """Start or go on with a run as a process of this machine; its output goes to log.txt in the run's folder.

    Raises BlockingIOError if another process is training it.
    """
    job.run.mkdir(parents=True, exist_ok=True)
    with (job.run / "log.txt").open("ab") as log, (job.run / "lock").open("w") as lock:
        take(lock.fileno(), job)
        command = job.command(job.config, job.run)
        return subprocess.Popen(
            command, stdin=lifeline(), stdout=log, stderr=subprocess.STDOUT, pass_fds=[lock.fileno()]
        )


@cache
def lifeline() -> int:
    """Return the end of a pipe that closes once this process is gone, even killed: a trainer saves and ends then."""
    return os.pipe()[0]


def take(lock: int, job: Job) -> None:
    """Lock a run's folder through an open file, which whoever trains it keeps open.

    Waits a while, as the trainers of a grid that was killed still save. Raises BlockingIOError.
    """
    deadline = time.monotonic() + GRACE_SECONDS
    while True:
        try:
            return fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            if time.monotonic() > deadline:
                raise BlockingIOError(f"another process is training {job.run}; end that one first") from None
        time.sleep(POLL_SECONDS)


def run_grid(
    jobs: Sequence[Job], parallel: int, results: Path, begin: Callable[[Job], Process] = start
) -> dict[Job, str]:
    """Run the jobs that are not finished, `parallel` at a time; return why those that failed did.

    begin: how to start a run. The metrics of each are kept in `results` as soon as it is finished. An
    interruption is passed on to the running jobs, which save.
    """
    finished = [job for job in jobs if job.finished()]
    waiting = [job for job in jobs if job not in finished]
    display = Display(waiting, len(finished))
    running: dict[Job, Process] = {}
    failed: dict[Job, str] = {}

    def keep(job: Job) -> None:
        try:
            keep_results(job, results)
        except FileExistsError as error:
            failed[job] = str(error)

    for job in finished:
        keep(job)
    try:
        with display.bars:
            while waiting or running:
                while waiting and len(running) < parallel:
                    job = waiting.pop(0)
                    try:
                        running[job] = begin(job)
                    except (OSError, ConfigError) as error:
                        failed[job] = str(error)
                        display.end(job, failed[job])
                for job, process in list(running.items()):
                    status = process.poll()
                    if status is not None:
                        del running[job]
                        if status:
                            failed[job] = job.complaint(status)
                        else:
                            keep(job)
                        display.end(job, failed.get(job))
                display.update(list(running))
                time.sleep(POLL_SECONDS)
    finally:
        end(list(running.values()))
    return failed


def end(processes: Sequence[Process]) -> None:
    """End processes and wait until they have saved.

    An interruption from the terminal has reached them already, and another one would disturb their saving: so they
    are only asked after a while.
    """
    deadline = time.monotonic() + GRACE_SECONDS
    while any(process.poll() is None for process in processes) and time.monotonic() < deadline:
        time.sleep(POLL_SECONDS)
    for process in processes:
        if process.poll() is None:
            process.terminate()
    for process in processes:
        process.wait()


def keep_results(job: Job, folder: Path) -> None:
    """Copy the metrics of a finished run to `folder`, one CSV per policy, as far as the job goes.

    Raises FileExistsError rather than replace another run, one of other rewards.
    """
    paths = sorted(job.run.glob("metrics-*.csv"))
    summary = load_config(job.config, job.settings()).log_interval
    for path in paths:
        policy = "" if len(paths) == 1 else path.stem.removeprefix("metrics")
        target = folder / f"{job.timesteps / 1e6:g}M" / f"{job.experiment}-s{job.seed}{policy}.csv"
        target.parent.mkdir(parents=True, exist_ok=True)
        rows = read_rows(path)
        wanted = sum(row["timesteps"] // summary <= job.timesteps // summary for row in rows)
        fresh = target.with_suffix(".new")
        fresh.write_text("".join(path.read_text().splitlines(keepends=True)[: 1 + wanted]))  # and the head
        if target.exists() and _rewards(target) != _rewards(fresh):
            fresh.unlink()
            raise FileExistsError(f"{target} holds another run; move it away, or give other --results than {folder}")
        fresh.replace(target)


def _rewards(path: Path) -> list[float | None]:
    return [row.get("reward") for row in read_rows(path)]


class Display:
    """One line per running run and one for all, with speed and the time left at that speed."""

    def __init__(self, jobs: Sequence[Job], finished: int) -> None:
        """Show the jobs that are to be run; `finished` more were so before."""
        self.console = Console(highlight=False)
        self.console.print(f"{len(jobs) + finished} runs, {finished} of them finished already")
        self.bars = Progress(
            TextColumn("{task.description:<32}"), BarColumn(bar_width=16), TextColumn("{task.fields[text]}"),
            TimeElapsedColumn(), console=self.console,
        )  # fmt: skip
        self.jobs = list(jobs)
        self.all = self.bars.add_task("all", total=None, text="")
        self.tasks = {job: self.bars.add_task(job.name, total=job.timesteps, visible=False, text="") for job in jobs}
        self.begin, self.first = time.monotonic(), {job: job.done() for job in jobs}
        self.done = dict(self.first)

    def update(self, running: Sequence[Job]) -> None:
        """Show how far the runs are."""
        for job in running:
            self.done[job] = job.done()
            text = f"{self.done[job] / 1e6:.1f} M"
            self.bars.update(self.tasks[job], completed=self.done[job], visible=True, text=text)
        total = sum(job.timesteps for job in self.jobs)
        done = sum(self.done[job] for job in self.jobs)
        before = sum(self.first[job] for job in self.jobs)
        text = time_left(total - done, (done - before) / (time.monotonic() - self.begin))
        self.bars.update(self.all, completed=done, total=total, text=text)

    def end(self, job: Job, complaint: str | None) -> None:
        """Show that a run has ended, and why if it failed; what failed no longer counts for the time left."""
        self.done[job] = job.done()
        self.bars.update(self.tasks[job], visible=False)
        if complaint is None:
            self.console.print(f"{job.name}: done")
        else:
            self.jobs.remove(job)
            self.console.print(f"{job.name}: failed: {complaint} (see {job.run / 'log.txt'})", soft_wrap=True)


def time_left(timesteps: int, speed: float) -> str:
    """Return speed and time left, once both can be told. speed: timesteps per second."""
    if speed <= 0:
        return "measuring"
    minutes = round(timesteps / speed / 60)
    return f"{speed / 1000:.1f} k timesteps/s, {minutes // 60} h {minutes % 60} min left"
