"""The progress of a grid on the terminal: a live table, and a line per finished run everywhere."""

import time
from collections.abc import Sequence
from statistics import mean

from rich.console import Console
from rich.live import Live
from rich.table import Table
from rich.text import Text

from joybridge.compare.job import Job
from joybridge.progress import Progress

SILENCE_SECONDS = 60.0  # without a line, where output is no terminal: runs take minutes


class Display:
    """A line per experiment and one for all, with the speed and the time left at that speed."""

    def __init__(self, jobs: Sequence[Job], finished: Sequence[Job]) -> None:
        """Show a grid. finished: those of its jobs that were finished before."""
        self.console = Console(highlight=False)
        how = "" if self.console.is_terminal else "; a line for each that ends, and every minute"  # else a live table
        self.console.print(f"{len(jobs)} runs, {len(finished)} of them already finished{how}", soft_wrap=True)
        self.jobs, self.ended, self.running = list(jobs), set(finished), set[Job]()
        self.rows = {job: job.last_row() for job in jobs}
        self.first = {job: self._done(job) if job.exact else 0 for job in jobs if job not in finished}  # nor failed
        self.begin: float | None = None  # of the measurement: when the first row was there, since its run compiled
        self.progress = Progress(self._print, SILENCE_SECONDS)
        self.live = Live(get_renderable=self.table, console=self.console, refresh_per_second=2, transient=True)

    def update(self, running: Sequence[Job]) -> None:
        """Show the progress of the running jobs and of all."""
        self.running = set(running)
        self.rows |= {job: job.last_row() for job in running}
        if self.begin is None:
            reached = {job: self._done(job) for job in running}
            if any(reached[job] > self.first[job] for job in running):
                self.begin, self.first = time.monotonic(), self.first | reached
        if not self.console.is_terminal:  # else a live table
            self.progress.report(f"{len(self.ended)} of {len(self.jobs)} runs finished; {self.time_left()}")

    def end(self, job: Job, failure: str | None) -> None:
        """Print that a job has ended, or why it failed. A failed job no longer counts for the time left."""
        self.rows[job] = job.last_row()
        self.running.discard(job)
        if failure is None:
            self.ended.add(job)
            reward = f", reward {self.rows[job]['reward']:.4g} in its last row" if "reward" in self.rows[job] else ""
            text = f"{job.name}: done{reward}"
        else:
            del self.first[job]
            text = f"{job.name}: failed: {failure} (see {job.run / 'log.txt'})"
        self._print(text)

    def table(self) -> Table:
        """Return what is shown live: the runs and timesteps of each experiment, and the mean of the last rewards."""
        table = Table(box=None, pad_edge=False, caption=self.time_left(), caption_justify="left")
        for head in ("experiment", "finished", "running", "timesteps", "reward"):
            table.add_column(head, justify="left" if head == "experiment" else "right")
        groups = {
            name: [job for job in self.jobs if job.experiment == name]
            for name in dict.fromkeys(job.experiment for job in self.jobs)
        }
        for name, jobs in [*groups.items(), ("all", self.jobs)]:
            share = sum(map(self._done, jobs)) / sum(job.timesteps for job in jobs)
            rewards = [self.rows[job]["reward"] for job in jobs if "reward" in self.rows[job]]
            table.add_row(
                Text(name),
                f"{len(self.ended.intersection(jobs))} of {len(jobs)}",
                f"{len(self.running.intersection(jobs))}",
                f"{100 * share:.0f} %",
                f"{mean(rewards):.4g}" if rewards and name in groups else "",
            )
        return table

    def time_left(self) -> str:
        """Return the speed of all running jobs and the time left at this speed."""
        done, first = sum(map(self._done, self.first)), sum(self.first.values())
        left = sum(job.timesteps for job in self.first) - done
        return time_left(left, (done - first) / (time.monotonic() - self.begin) if self.begin else 0.0)

    def _print(self, text: str) -> None:
        self.console.print(text, soft_wrap=True, markup=False)

    def _done(self, job: Job) -> int:
        """Return the timesteps of a job that the table knows of."""
        return min(job.timesteps, int(self.rows[job].get("timesteps", 0)))


def time_left(timesteps: int, speed: float) -> str:
    """Return the speed and the time left as text. speed: timesteps per second, 0 before the first measurement."""
    if speed <= 0:
        return "measuring"
    minutes = round(timesteps / speed / 60)
    return f"{speed / 1000:.1f} k timesteps/s, {minutes // 60} h {minutes % 60} min left"
