"""What a run reports: finished episodes, statistics of updates, and where the time goes.

A row every `summary` timesteps, the mean over everything since the row before, goes to a CSV file per
policy and to TensorBoard.
"""

import csv
import re
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from torch.utils.tensorboard import SummaryWriter

from joybridge.contract.codec import StepArrays
from joybridge.contract.tensors import Array

Row = dict[str, float]

ACTIVITIES = ("simulate", "wire", "act", "learn")
OF_EVERY_GAME = {  # columns of metrics; the others are the game's own
    "timesteps", "episodes", "reward", "reward_std", "length", "policy_loss", "value_loss", "entropy", "value",
    "timesteps_per_second", *ACTIVITIES,
}  # fmt: skip


class Episodes:
    """Sums up the episodes of one policy's lanes."""

    def __init__(self, lanes: int, metrics: Sequence[str]) -> None:
        """Begin at an episode's first decision in every lane.

        metrics: the game's, by name; those called like a column of the trainer's own get "game_" before it.
        """
        self.metrics = [f"game_{name}" if name in OF_EVERY_GAME else name for name in metrics]
        self.reward = np.zeros(lanes)
        self.length = np.zeros(lanes, np.int64)
        self.finished = np.zeros((0, 3 + len(self.metrics)))  # lane, reward, length, metrics of each episode

    def begin(self) -> None:
        """Forget the episodes that have begun: new ones begin in every lane."""
        self.reward[:] = 0.0
        self.length[:] = 0

    def add(self, step: StepArrays, rewards: Array, lanes: slice = slice(None)) -> None:
        """Count one step of some lanes: rewards as the policy is paid."""
        self.reward[lanes] += rewards
        self.length[lanes] += 1
        if len(step.ended):
            ended = step.ended + (lanes.start or 0)
            columns = [ended[:, None], self.reward[ended, None], self.length[ended, None]]
            if step.metrics is not None:
                columns.append(step.metrics)
            self.finished = np.concatenate([self.finished, np.concatenate(columns, axis=1)])
            self.reward[ended] = 0.0
            self.length[ended] = 0

    def summarise(self) -> Row:
        """Return means over the finished episodes and forget them; no means where none has finished."""
        finished, self.finished = self.finished, self.finished[:0]
        row: Row = {"episodes": len(finished)}
        if len(finished):
            means = finished.mean(axis=0)
            row |= {"reward": means[1], "reward_std": finished[:, 1].std(), "length": means[2]}
            row |= dict(zip(self.metrics, means[3:].tolist(), strict=True))
        return row

    def state(self) -> dict[str, Array]:
        """Return everything for a checkpoint."""
        return {"reward": self.reward.copy(), "length": self.length.copy(), "finished": self.finished.copy()}

    def load(self, state: dict[str, Array]) -> None:
        """Take back what `state` returned."""
        self.reward, self.length, self.finished = (state[name].copy() for name in ("reward", "length", "finished"))


class Means:
    """The mean of each statistic since the last row."""

    def __init__(self) -> None:
        self.values: dict[str, list[float]] = {}

    def add(self, statistics: Row) -> None:
        """Count the statistics of one update."""
        for name, value in statistics.items():
            self.values.setdefault(name, []).append(value)

    def summarise(self) -> Row:
        """Return the means and begin anew."""
        row = {name: float(np.mean(values)) for name, values in self.values.items()}
        self.values = {}
        return row

    def state(self) -> dict[str, Array]:
        """Return everything for a checkpoint."""
        return {name: np.array(values) for name, values in self.values.items()}

    def load(self, state: dict[str, Array]) -> None:
        """Take back what `state` returned."""
        self.values = {name: values.tolist() for name, values in state.items()}


class Stopwatch:
    """Where the time goes: seconds by activity since the last row."""

    def __init__(self) -> None:
        self.seconds: Row = {"simulate": 0.0, "wire": 0.0, "act": 0.0, "learn": 0.0}
        self.begin = time.perf_counter()
        self.timesteps = 0

    @contextmanager
    def measure(self, activity: str) -> Iterator[None]:
        """Add the time of the block to an activity."""
        begin = time.perf_counter()
        yield
        self.seconds[activity] += time.perf_counter() - begin

    @contextmanager
    def measure_wait(self, simulate_seconds: Callable[[], float]) -> Iterator[None]:
        """Split the time of the block, a wait for the simulators, into their own work and the wire."""
        begin = time.perf_counter()
        yield
        waited = time.perf_counter() - begin
        simulated = min(waited, simulate_seconds())  # less was waited for where learning overlapped
        self.seconds["simulate"] += simulated
        self.seconds["wire"] += waited - simulated

    def shares(self) -> Row:
        """Return each activity's share of the time since the last row."""
        elapsed = max(time.perf_counter() - self.begin, 1e-9)
        return {name: seconds / elapsed for name, seconds in self.seconds.items()}

    def speed(self) -> float:
        """Return timesteps per second since the last row."""
        return self.timesteps / max(time.perf_counter() - self.begin, 1e-9)

    def live(self) -> Row:
        """Return speed and shares."""
        return {"timesteps_per_second": self.speed(), **self.shares()}

    def summarise(self) -> Row:
        """Return speed and shares, and begin anew."""
        row = self.live()
        self.__init__()  # type: ignore[misc]
        return row


class Writer:
    """Writes one policy's rows to metrics-NAME.csv and to TensorBoard under the run's folder."""

    def __init__(self, run: Path, policy: str, after: int) -> None:
        """Begin, or go on after so many timesteps; later rows, of a run that was cut off, are dropped."""
        name = re.sub(r"[/\\%\0]", lambda match: f"%{ord(match[0]):02X}", policy)  # no path of its own
        self.path = run / f"metrics-{name}.csv"
        self.rows = [cells for cells in _read_cells(self.path) if float(cells["timesteps"]) <= after]
        self._save()
        self.board = SummaryWriter(run / "tensorboard" / name, purge_step=after + 1)

    def write(self, row: Row) -> None:
        """Write one row; it holds "timesteps"."""
        self.rows.append(
            {name: f"{value:.6g}" if isinstance(value, float) else f"{value}" for name, value in row.items()}
        )
        self._save()
        for name, value in row.items():
            self.board.add_scalar(name, value, int(row["timesteps"]))
        self.board.flush()

    def _save(self) -> None:
        """Write the whole file, so that columns may come in later and an interruption never leaves half of it."""
        if not self.rows:
            self.path.unlink(missing_ok=True)
            return
        fresh = self.path.with_suffix(".new")
        with fresh.open("w", newline="") as file:
            table = csv.DictWriter(file, dict.fromkeys(name for cells in self.rows for name in cells))
            table.writeheader()
            table.writerows(self.rows)
        fresh.replace(self.path)

    def close(self) -> None:
        """Finish the TensorBoard file."""
        self.board.close()


class Journal:
    """What one policy reports: its episodes and updates, written as a row now and then."""

    def __init__(self, run: Path, policy: str, lanes: int, metrics: Sequence[str], after: int) -> None:
        """Begin, or go on after so many timesteps; see Episodes and Writer."""
        self.episodes, self.means = Episodes(lanes, metrics), Means()
        self.writer = Writer(run, policy, after)

    def write(self, timesteps: int, shared: Row) -> Row:
        """Write a row, with figures that all policies share; return it."""
        row: Row = {"timesteps": timesteps, **self.episodes.summarise(), **self.means.summarise(), **shared}
        self.writer.write(row)
        return row


def read_rows(path: Path) -> list[Row]:
    """Return the rows of a metrics file; empty cells are left out."""
    return [{name: float(cell) for name, cell in cells.items()} for cells in _read_cells(path)]


def _read_cells(path: Path) -> list[dict[str, str]]:
    if not path.exists():
        return []
    with path.open(newline="") as file:
        return [{name: cell for name, cell in cells.items() if cell} for cells in csv.DictReader(file)]
