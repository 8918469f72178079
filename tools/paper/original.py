"""The original's published results: its logs of ten runs per experiment, and the figures that its paper prints.

In `data/`, by game, layout and policy: `curves.csv` holds the mean and the standard deviation over the ten runs of
reward and episode length at some steps, `ends.csv` the last figures of each run, and `printed.csv` the figures in the
paper's text and plots. One step of the original is one decision of each of its 15 arenas. Its episode lengths do not
count an episode's last decision.
"""

import csv
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from tools.paper.statistics import Sample

DATA = Path(__file__).with_name("data")
TIMESTEPS_PER_STEP = 15


@dataclass(frozen=True)
class Point:
    """Mean and standard deviation over the original's ten runs, at one step of an experiment."""

    timesteps: int
    reward: float
    reward_std: float
    length: float
    length_std: float
    runs: int  # which differ

    @property
    def sample(self) -> Sample:
        """Return the rewards of the runs."""
        return Sample(self.reward, self.reward_std, self.runs, self.runs - 1)


@dataclass(frozen=True)
class Ends:
    """How the original's runs of an experiment ended, one figure per run; a run that is in its logs twice is one."""

    reward: tuple[float, ...]  # of the last row
    last_ten: tuple[float, ...]  # mean reward of the last ten rows
    length: tuple[float, ...]  # decisions per episode of the last row
    hours: tuple[float, ...]  # wall-clock of the whole run


@cache
def original_curve(game: str, layout: str, policy: str = "") -> tuple[Point, ...]:
    """Return the curve of an experiment, empty where the original has none.

    policy: "axes" or "buttons" of multiagent, whose rewards differ; else "".
    """
    ends = original_ends(game, layout, policy)
    runs = len(ends.reward) if ends else 0
    return tuple(
        Point(
            int(row["step"]) * TIMESTEPS_PER_STEP,
            float(row["reward"]),
            float(row["reward_std"]),
            float(row["length"]),
            float(row["length_std"]),
            runs,
        )
        for row in _table("curves.csv", game, layout, policy)
    )


def original_point(game: str, layout: str, policy: str, timesteps: int) -> Point | None:
    """Return the original's figures at a number of timesteps, or None where it has none."""
    points = original_curve(game, layout, policy)
    return next((point for point in points if point.timesteps == timesteps), None)


@cache
def original_ends(game: str, layout: str, policy: str = "") -> Ends | None:
    """Return how the original's runs of an experiment ended, or None where it has none; policy as above."""
    rows = {row["reward"] + row["last_ten"] + row["length"]: row for row in _table("ends.csv", game, layout, policy)}
    columns = [tuple(float(row[name]) for row in rows.values()) for name in ("reward", "last_ten", "length", "hours")]
    return Ends(*columns) if rows else None


@cache
def paper_figures(game: str, layout: str) -> dict[str, float]:
    """Return what the paper prints of an experiment: reward, accuracy, length, hours, as far as it does."""
    rows = _table("printed.csv", game, layout)
    return {key: float(row[key]) for row in rows for key in ("reward", "accuracy", "length", "hours") if row[key]}


def _table(name: str, game: str, layout: str, policy: str = "") -> list[dict[str, str]]:
    """Return the rows of an experiment in one of the files in `data/`."""
    with (DATA / name).open(newline="") as file:
        rows = [row for row in csv.DictReader(file) if (row["game"], row["layout"]) == (game, layout)]
    return [row for row in rows if row.get("policy", "") in ("", policy)]
