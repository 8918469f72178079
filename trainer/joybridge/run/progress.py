"""The progress of a run on screen: a live line in a terminal, and a line per row of metrics everywhere.

Where output is no terminal, a game that is too slow for a row of metrics gets a line by time.
"""

import time
from typing import Self

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from joybridge.config.metrics import ACTIVITIES, HELD_OUT, Row, is_builtin_metric
from joybridge.progress import minutes_left

SILENCE_SECONDS = 30.0  # the longest time without a line
LEARNER = ("entropy", "approx_kl", "explained_variance")  # of the statistics of updates: whether it learns at all


class Display:
    """Shows the progress of one run; `report` is given to `train`."""

    def __init__(self, heading: str, name: str, end: int, begin: int) -> None:
        """Show a run that goes from `begin` to `end` timesteps. heading: printed once it has begun."""
        self.heading, self.end = heading, end
        self.console = Console(highlight=False)
        self.plain = not self.console.is_terminal  # without the live line, which says how long it still takes
        self.bar = Progress(
            TextColumn("[bold]{task.description}"),
            BarColumn(bar_width=20),
            TextColumn("{task.percentage:3.0f} %  {task.fields[text]}"),
            TimeRemainingColumn(),
            console=self.console,
            disable=self.plain,
        )
        self.task = self.bar.add_task(name, total=end, completed=begin, text="")
        self.reward, self.rows = "", 0
        self.printed = time.monotonic()

    def report(self, timesteps: int, live: Row, row: Row | None) -> None:
        """Show where the run is: live figures, and now and then a new row of metrics."""
        if self.heading:
            self.say(self.heading)
            self.heading = ""
        shares = " ".join(f"{name} {100 * live[name]:.0f} %" for name in ACTIVITIES)
        speed = _speed(live["timesteps_per_second"])
        if row is not None:
            rate = live["timesteps_per_second"] if self.plain and self.rows else 0.0  # at first, something is compiled
            left = minutes_left((self.end - timesteps) / rate) if rate > 0 else ""
            self.rows += 1
            if "reward" in row:
                self.reward = f"reward {reward_text(row['reward'])}"
            self.say(f"{timesteps:>11,}  {row_text(row)}  {speed}  ({shares}){left}")
        elif self.plain and time.monotonic() - self.printed > SILENCE_SECONDS:
            self.say(f"{timesteps:>11,}  {speed}  ({shares})")
        self.bar.update(self.task, completed=timesteps, text=f"{self.reward}  {speed}  ({shares})")

    def say(self, text: str) -> None:
        """Print a line, above the live one."""
        self.console.print(text, soft_wrap=True, markup=False)
        self.printed = time.monotonic()

    def __enter__(self) -> Self:
        self.bar.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.bar.stop()


def row_text(row: Row) -> str:
    """Return what a row of metrics of a policy says: how it plays, and whether it learns."""
    parts = ["no episode ended"]
    if "reward" in row:
        parts = [f"reward {reward_text(row['reward'])}  length {row['length']:.0f}"]
    if "interrupted" in row:
        parts.append(f"{row['interrupted']:.0f} episodes cut by errors of the game")
    if "ahead" in row:  # of opponents: in play against itself, a reward says little
        parts.append(f"ahead {row['ahead']:.0%}")
    if text := held_out_text(row):
        parts.append(text)
    parts.append("  ".join(f"{name} {value:.3g}" for name, value in row.items() if not is_builtin_metric(name)))
    parts.append("  ".join(f"{name} {row[name]:.2g}" for name in LEARNER if name in row))
    return "  ".join(parts)


def held_out_text(row: Row) -> str:
    """Return what a row says of held-out settings; "" if they were not played."""
    return f"held out {reward_text(row[f'{HELD_OUT}reward'])}" if f"{HELD_OUT}reward" in row else ""


def reward_text(reward: float) -> str:
    """Return a reward with one decimal, or with two digits where that would be nearly nothing, such as 0.031."""
    return f"{reward:.1f}" if abs(reward) >= 0.1 or reward == 0.0 else f"{reward:.2g}"


def _speed(timesteps: float) -> str:
    """Return a number of timesteps per second in words."""
    return f"{timesteps / 1000:.1f} k timesteps/s" if timesteps >= 1000 else f"{timesteps:.1f} timesteps/s"
