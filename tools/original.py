"""The original's published results: learning curves of its ten runs per experiment.

`original.csv` holds, per game, layout and policy, the mean and the standard deviation over ten runs of reward
and episode length at some of its steps. One step of the original is one decision of each of its 15 arenas.
"""

import csv
from dataclasses import dataclass
from functools import cache
from pathlib import Path

TRANSITIONS_PER_STEP = 15


@dataclass(frozen=True)
class Point:
    """Mean and standard deviation over the original's ten runs, at one step of an experiment."""

    transitions: int
    reward: float
    reward_std: float
    length: float
    length_std: float


@cache
def original_curve(game: str, layout: str, policy: str = "") -> tuple[Point, ...]:
    """Return the curve of an experiment, empty where the original has none.

    policy: "axes" or "buttons" of multiagent, whose rewards differ; else "".
    """
    with Path(__file__).with_name("original.csv").open(newline="") as file:
        rows = [row for row in csv.DictReader(file) if (row["game"], row["layout"]) == (game, layout)]
    return tuple(
        Point(
            int(row["step"]) * TRANSITIONS_PER_STEP,
            *(float(row[name]) for name in ("reward", "reward_std", "length", "length_std")),
        )
        for row in rows
        if row["policy"] in ("", policy)
    )
