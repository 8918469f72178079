"""The progress of a grid on the terminal."""

import time
from collections.abc import Sequence

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from joybridge.experiments.job import Job


class Display:
    """One line per running job and one for all jobs, with the speed and the time left at that speed."""

    def __init__(self, jobs: Sequence[Job], finished: int) -> None:
        """Show the jobs to run. finished: how many others were finished before."""
        self.console = Console(highlight=False)
        self.console.print(f"{len(jobs) + finished} runs, {finished} of them already finished")
        self.bars = Progress(
            TextColumn("{task.description:<32}"), BarColumn(bar_width=16), TextColumn("{task.fields[text]}"),
            TimeElapsedColumn(), console=self.console,
        )  # fmt: skip
        self.jobs = list(jobs)
        self.all = self.bars.add_task("all", total=None, text="")
        self.tasks = {
            job: self.bars.add_task(str(job.name), total=job.timesteps, visible=False, text="") for job in jobs
        }
        self.started, self.first = time.monotonic(), {job: job.done() for job in jobs}
        self.done = dict(self.first)

    def update(self, running: Sequence[Job]) -> None:
        """Show the progress of the running jobs and of all."""
        for job in running:
            self.done[job] = job.done()
            text = f"{self.done[job] / 1e6:.1f} M"
            self.bars.update(self.tasks[job], completed=self.done[job], visible=True, text=text)
        total = sum(job.timesteps for job in self.jobs)
        done = sum(self.done[job] for job in self.jobs)
        before = sum(self.first[job] for job in self.jobs)
        text = time_left(total - done, (done - before) / (time.monotonic() - self.started))
        self.bars.update(self.all, completed=done, total=total, text=text)

    def end(self, job: Job, failure: str | None) -> None:
        """Print that a job has ended, or why it failed. A failed job no longer counts for the time left."""
        self.done[job] = job.done()
        self.bars.update(self.tasks[job], visible=False)
        if failure is None:
            self.console.print(f"{job.name}: done")
        else:
            self.jobs.remove(job)
            self.console.print(f"{job.name}: failed: {failure} (see {job.run / 'log.txt'})", soft_wrap=True)


def time_left(timesteps: int, speed: float) -> str:
    """Return the speed and the time left as text. speed: timesteps per second, 0 before the first measurement."""
    if speed <= 0:
        return "measuring"
    minutes = round(timesteps / speed / 60)
    return f"{speed / 1000:.1f} k timesteps/s, {minutes // 60} h {minutes % 60} min left"
