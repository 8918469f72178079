"""Our finished runs in a folder of results, by experiment."""

from dataclasses import dataclass
from functools import cached_property
from itertools import groupby
from pathlib import Path
from statistics import mean

from joybridge.compare import read_table
from joybridge.config.metrics import Row, numbers

MARK = 300_000  # timesteps between two rows of metrics, equal to 20 000 of the original's steps
COMPLETE = 30_000_000  # timesteps of a complete run
GAMES = ("shooting_birds", "beastly_rivals")
LAYOUTS = (
    "bucket-11",
    "bucket-3",
    "bucket-41",
    "threshold-0.0",
    "threshold-0.1",
    "threshold-0.5",
    "multiagent",
    "hybrid",
)


@dataclass(frozen=True)
class Run:
    """The metrics of one policy of one run."""

    seed: int
    rows: dict[int, Row]  # by mark: the nearest multiple of MARK timesteps

    @property
    def end(self) -> int:
        """Return the last mark."""
        return max(self.rows)

    @cached_property
    def hours(self) -> float:
        """Return the wall-clock time of all rows in hours."""
        return sum(MARK / row["timesteps_per_second"] for row in self.rows.values()) / 3600

    @property
    def complete_hours(self) -> float:
        """Return the hours that a complete run takes at this run's speed."""
        return self.hours * COMPLETE / (MARK * len(self.rows))


@dataclass(frozen=True)
class Experiment:
    """The runs of one policy of one experiment."""

    game: str
    layout: str
    policy: str  # "axes" or "buttons" of multiagent, else ""
    runs: tuple[Run, ...]
    alone: tuple[Run, ...] = ()  # short runs, one at a time on an otherwise idle machine, for their speed

    @property
    def name(self) -> str:
        """Return the name of the experiment within its game."""
        return f"{self.layout}, {self.policy}" if self.policy else self.layout

    @property
    def marks(self) -> list[int]:
        """Return every mark that a run has reached."""
        return sorted({mark for run in self.runs for mark in run.rows})

    def at(self, mark: int, key: str = "reward") -> list[float]:
        """Return a metric at a mark, of each run that has it."""
        return [run.rows[mark][key] for run in self.runs if key in run.rows.get(mark, {})]

    @property
    def complete(self) -> tuple[Run, ...]:
        """Return the complete runs."""
        return tuple(run for run in self.runs if run.end >= COMPLETE)


Key = tuple[str, str, str]  # game, layout and policy
Results = dict[Key, Experiment]


def read_results(folder: Path) -> Results:
    """Return the runs of the paper's games in a folder of results; of several lengths of a run the longest.

    A seed counts as one run, however often it was started: runs of the same seed with the same first reward are lengths
    of one run, and of others, which differ in rounding errors, the mean counts. Runs in the folder `alone` count for
    speed only.
    """
    alone = _read_runs(folder / "alone")
    return {key: Experiment(*key, runs, alone.get(key, ())) for key, runs in _read_runs(folder).items()}


def _read_runs(folder: Path) -> dict[Key, tuple[Run, ...]]:
    """Return a run per seed, by experiment in the order of LAYOUTS."""
    longest: dict[Key, dict[tuple[int, float], Run]] = {}  # within an experiment, by seed and first reward
    for name, cells in read_table(folder).items():
        game, _, layout = name.run.experiment.partition("/")
        rows = {round(row["timesteps"] / MARK) * MARK: row for row in numbers(cells) if "reward" in row}
        if game in GAMES and rows:
            runs = longest.setdefault((game, layout, name.policy), {})
            run, beginning = Run(name.run.seed, rows), (name.run.seed, rows[min(rows)]["reward"])
            runs[beginning] = max(run, runs.get(beginning, run), key=lambda each: each.end)
    return {
        key: tuple(_mean(list(same)) for _, same in groupby(sorted(runs.values(), key=_seed), _seed))
        for key, runs in sorted(longest.items(), key=lambda item: _place(*item[0]))
    }


def _seed(run: Run) -> int:
    return run.seed


def _mean(runs: list[Run]) -> Run:
    """Return the means of some runs of one seed, at every mark of those that have reached it."""
    marks = sorted({mark for run in runs for mark in run.rows})
    at = {mark: [run.rows[mark] for run in runs if mark in run.rows] for mark in marks}
    return Run(
        runs[0].seed,
        {mark: {key: mean(row[key] for row in rows if key in row) for key in rows[0]} for mark, rows in at.items()},
    )


def _place(game: str, layout: str, policy: str) -> tuple[int, int, str, str]:
    """Return a sort key: the order of GAMES and LAYOUTS, other layouts last."""
    return GAMES.index(game), LAYOUTS.index(layout) if layout in LAYOUTS else len(LAYOUTS), layout, policy


def main_policy(layout: str) -> str:
    """Return the policy whose reward counts for a layout: for multiagent the one that clicks, as in the paper."""
    return "buttons" if layout == "multiagent" else ""
