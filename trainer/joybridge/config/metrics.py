"""The metrics files of a run: which columns the trainer writes, and reading and writing them. Needs no torch."""

import csv
import io
import math
import re
from collections.abc import Collection, Sequence
from pathlib import Path

from joybridge.config.errors import CheckpointError
from joybridge.config.files import write_atomically
from joybridge.contract.files import read_file

MAX_METRICS_BYTES = 2**26  # bytes of a file of metrics

Row = dict[str, float]
Cells = dict[str, str]  # a row as text

ACTIVITIES = ("simulate", "wire", "act", "learn")  # fractions of the time
# What the loss reports of a minibatch; the entropy of each branch follows.
STATISTICS = ("policy_loss", "value_loss", "entropy", "approx_kl", "clip_fraction")
_COLUMNS = {
    "timesteps", "seconds", "lesson", "episodes", "interrupted", "reward", "reward_std", "length", *STATISTICS, "value",
    "explained_variance", "grad_norm", "epochs", "cloning_loss", "learning_rate", "ahead",
    "timesteps_per_second", *ACTIVITIES,
}  # fmt: skip
HELD_OUT = "held_out_"  # begins the columns of `evaluate_during`
COUNTS = {"timesteps", "episodes", f"{HELD_OUT}episodes"}  # columns that are never negative or infinite
KEYS = ("run", "experiment", "seed", "total_timesteps", "policy")  # what a table of several runs adds to a row
RESERVED = {*KEYS, "game", "layout"}  # what any table adds


def column_name(metric: str) -> str:
    """Return the column of a metric of the game: its name, after "game_" if there is another column of that name."""
    return f"game_{metric}" if is_builtin_metric(metric) or metric in RESERVED else metric


def is_builtin_metric(column: str) -> bool:
    """Return whether the trainer writes a column for every game; the others are metrics of the game."""
    return column in _COLUMNS or column.startswith(("entropy_", "loss_", HELD_OUT))


def is_of_episodes(column: str) -> bool:
    """Return whether a row has the mean over the episodes of the training that have ended in it."""
    return not is_builtin_metric(column) or column in measured_columns([])


def measured_columns(metrics: Sequence[str], games: Sequence[str] = ()) -> list[str]:
    """Return the columns of episodes that held-out settings have, too. metrics, games: of a session, by name."""
    of_games = [f"{game}.{name}" for game in games for name in ("reward", "length")]
    return ["reward", "length", *of_games, *map(column_name, metrics), "reward_std", "episodes"]


def training_columns() -> list[str]:
    """Return the columns that the trainer alone writes, whatever the game."""
    return sorted(_COLUMNS - {"timesteps", *measured_columns(())})


def metrics_name(policy: str) -> str:
    """Return the name of a policy in the names of files: never a path of its own."""
    return re.sub(r"[/\\%\0]|^\.+$", lambda match: "".join(f"%{ord(char):02X}" for char in match[0]), policy)


def read_rows(path: Path) -> list[Row]:
    """Return the rows of a metrics file; empty cells are left out."""
    return numbers(read_cells(path))


def numbers(rows: list[Cells]) -> list[Row]:
    """Return rows of text as numbers."""
    return [{name: float(cell) for name, cell in cells.items()} for cells in rows]


def read_cells(path: Path) -> list[Cells]:
    """Return the rows of a metrics file as text, none where there is no file; empty cells are left out.

    Raises CheckpointError unless all cells are numbers and every row has its timesteps.
    """
    try:
        return parse_cells(read_file(path, MAX_METRICS_BYTES).decode())
    except FileNotFoundError:
        return []
    except (OSError, ValueError) as error:
        raise CheckpointError(f"{path} is no file of metrics ({error}); move it away") from error


def parse_cells(text: str, but: Collection[str] = ()) -> list[Cells]:
    """Return the rows of a CSV; empty cells are left out.

    but: columns that need not be numbers. Raises ValueError unless all other cells are, and every row has its
    timesteps.
    """
    try:
        rows = [{name: cell for name, cell in cells.items() if cell} for cells in csv.DictReader(io.StringIO(text))]
        for cells in rows:
            for name, cell in cells.items():
                if name not in but:
                    float(cell)
            if "timesteps" not in cells:
                raise ValueError("a row without timesteps")
            for name in COUNTS & cells.keys():
                if not 0 <= float(cells[name]) < math.inf:
                    raise ValueError(f"{name} is {cells[name]}")
    except (TypeError, csv.Error) as error:
        raise ValueError(f"{error}") from error
    return rows


def cells_of(row: Row) -> Cells:
    """Return a row as text, with six digits of each number that is not whole."""
    return {name: f"{value:.6g}" if isinstance(value, float) else f"{value}" for name, value in row.items()}


def write_cells(path: Path, rows: list[Cells]) -> None:
    """Write a whole metrics file, so that columns may be added later; without rows there is no file."""
    if not rows:
        path.unlink(missing_ok=True)
        return
    text = io.StringIO(newline="")
    table = csv.DictWriter(text, dict.fromkeys(name for cells in rows for name in cells))
    table.writeheader()
    table.writerows(rows)
    write_atomically(path, text.getvalue().encode())
