"""The progress of a search on the terminal: a live table, and a line per trial that has ended everywhere."""

from collections.abc import Mapping, Sequence

from rich.console import Console
from rich.live import Live
from rich.table import Table
from rich.text import Text

from joybridge.compare.job import Job
from joybridge.compare.ranges import Range
from joybridge.compare.trials import Trial, best_trial


class Display:
    """A line per trial that is trained now, one for the best so far, and how many have ended."""

    def __init__(self, ranges: Sequence[Range], wanted: int, timesteps: int) -> None:
        """Show a search for `wanted` trials of so many timesteps each."""
        self.console = Console(highlight=False)
        self.keys, self.wanted, self.timesteps = [each.key for each in ranges], wanted, timesteps
        self.trials: Sequence[Trial] = []
        self.running: Mapping[int, Job] = {}
        self.live = Live(get_renderable=self.table, console=self.console, refresh_per_second=2, transient=True)

    def update(self, trials: Sequence[Trial], running: Mapping[int, Job]) -> None:
        """Show all trials so far, of which some are trained now, by number."""
        self.trials, self.running = list(trials), running

    def end(self, number: int, trial: Trial) -> None:
        """Print what a trial has come to."""
        settings = ", ".join(f"{short(key)}={value}" for key, value in trial.settings.items())
        self.console.print(f"trial {number}: {outcome(trial)} ({settings})", soft_wrap=True, markup=False)

    def table(self) -> Table:
        """Return what is shown live."""
        table = Table(box=None, pad_edge=False, caption=self._count(), caption_justify="left")
        for head in ("trial", *map(short, self.keys), "timesteps", "reward"):
            table.add_column(head, justify="left" if head == "trial" else "right")
        for number, job in self.running.items():
            row = job.last_row()
            reward = f"{row['reward']:.4g}" if "reward" in row else ""
            share = min(1.0, row.get("timesteps", 0) / self.timesteps)
            self._add(table, f"{number}", self.trials[number], f"{100 * share:.0f} %", reward)
        if (best := best_trial(self.trials)) is not None:
            trial = self.trials[best]
            self._add(table, f"best: {best}", trial, "", f"{trial.score:.4g}")
        return table

    def _add(self, table: Table, name: str, trial: Trial, *cells: str) -> None:
        table.add_row(name, *(Text(trial.settings[key]) for key in self.keys), *cells)

    def _count(self) -> str:
        states = [trial.state for trial in self.trials]
        counts = (f"{states.count(state)} {state}" for state in ("complete", "pruned", "failed") if state in states)
        return f"of {self.wanted} trials: {', '.join(counts) or 'none has ended'}"


def short(key: str) -> str:
    """Return a key as tables call it."""
    return key.removeprefix("policy.")


def outcome(trial: Trial) -> str:
    """Return what a trial has come to, in words."""
    if trial.state == "complete":
        return f"complete, score {trial.score:.4g}"
    if trial.state == "pruned":
        return f"pruned after {trial.timesteps:,} timesteps, score {list(trial.rungs.values())[-1]:.4g}"
    return f"failed: {trial.reason}" if trial.state == "failed" else "running"
