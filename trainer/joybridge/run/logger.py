"""The metrics of one policy: a row every `log_interval` timesteps, to a CSV file and to the sinks of `log_to`."""

import time
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from joybridge.config.config import Config
from joybridge.config.metrics import Row, cells_of, metrics_name, read_cells, write_cells
from joybridge.contract.tensors import Array
from joybridge.run.sinks import Sinks


class RunningMean:
    """The mean of each statistic since the last row."""

    def __init__(self) -> None:
        self.values: dict[str, list[float]] = {}

    def add(self, statistics: Mapping[str, float]) -> None:
        """Count the statistics of one update."""
        for name, value in statistics.items():
            self.values.setdefault(name, []).append(value)

    def summarize(self) -> Row:
        """Return the means and start over."""
        row = {name: float(np.mean(values)) for name, values in self.values.items()}
        self.values = {}
        return row

    def state(self) -> dict[str, Array]:
        """Return everything for a checkpoint."""
        return {name: np.array(values) for name, values in self.values.items()}

    def load(self, state: dict[str, Array]) -> None:
        """Take back what `state` returned."""
        self.values = {name: values.tolist() for name, values in state.items()}


class Logger:
    """Writes the rows of one policy to metrics-NAME.csv in the folder of a run, and to its sinks."""

    def __init__(self, run: Path, policy: str, after: int, config: Config) -> None:
        """Begin, or continue after so many timesteps; later rows, of a run that was cut off, are dropped.

        Raises CheckpointError for a file of metrics that cannot be read, and StorageError.
        """
        self.mean = RunningMean()
        self.path = run / f"metrics-{metrics_name(policy)}.csv"
        self.rows = [cells for cells in read_cells(self.path) if float(cells["timesteps"]) <= after]
        write_cells(self.path, self.rows)
        before = float(self.rows[-1].get("seconds", 0)) if self.rows else 0.0
        self._begin = time.monotonic() - before
        self._sinks = Sinks(run, policy, after, config)

    def write(self, timesteps: int, episodes: Row, times: Row) -> Row:
        """Write a row: figures of the episodes since the last one, means over its updates, and times; return it."""
        seconds = time.monotonic() - self._begin
        row = {"timesteps": timesteps, "seconds": seconds, **episodes, **self.mean.summarize(), **times}
        self.rows.append(cells_of(row))
        write_cells(self.path, self.rows)
        self._sinks.write(timesteps, row)
        return row

    def complete(self, columns: Row) -> None:
        """Add columns to the last row, if there is one."""
        if self.rows:
            self.rows[-1] |= cells_of(columns)
            write_cells(self.path, self.rows)
            self._sinks.write(int(float(self.rows[-1]["timesteps"])), columns)

    def close(self) -> None:
        """Finish the sinks."""
        self._sinks.close()
