"""The metrics files of a run: which columns the trainer writes, and reading and writing them. Needs no torch."""

import csv
import io
import re
from pathlib import Path

from joybridge.config.errors import CheckpointError
from joybridge.config.files import write_atomically
from joybridge.contract.files import read_file

LARGEST = 2**26  # bytes of a file of metrics

Row = dict[str, float]
Cells = dict[str, str]  # a row as text

ACTIVITIES = ("simulate", "wire", "act", "learn")  # fractions of the time
# What the loss reports of a minibatch; the entropy of each branch follows.
STATISTICS = ("policy_loss", "value_loss", "entropy", "approx_kl", "clip_fraction")
_COLUMNS = {
    "timesteps", "seconds", "lesson", "episodes", "reward", "reward_std", "length", *STATISTICS, "value",
    "explained_variance", "grad_norm", "epochs", "cloning_loss", "learning_rate", "timesteps_per_second", *ACTIVITIES,
}  # fmt: skip


def column_name(metric: str) -> str:
    """Return the column of a metric of the game, which is its name, after "game_" if the trainer has such a column."""
    return f"game_{metric}" if is_trainers(metric) else metric


def is_trainers(column: str) -> bool:
    """Return whether the trainer writes a column for every game; the others are metrics of the game."""
    return column in _COLUMNS or column.startswith("entropy_")


def metrics_name(policy: str) -> str:
    """Return the name of a policy in the names of files: never a path of its own."""
    return re.sub(r"[/\\%\0]", lambda match: f"%{ord(match[0]):02X}", policy)


def read_rows(path: Path) -> list[Row]:
    """Return the rows of a metrics file; empty cells are left out."""
    return [{name: float(cell) for name, cell in cells.items()} for cells in read_cells(path)]


def read_cells(path: Path) -> list[Cells]:
    """Return the rows of a metrics file as text, none where there is no file; empty cells are left out.

    Raises CheckpointError unless all cells are numbers and every row has its timesteps.
    """
    try:
        text = read_file(path, LARGEST).decode()
        rows = [{name: cell for name, cell in cells.items() if cell} for cells in csv.DictReader(io.StringIO(text))]
        if not all(float(cells["timesteps"]) >= 0 for cells in rows):
            raise ValueError("negative timesteps")
        for cells in rows:
            for cell in cells.values():
                float(cell)
    except FileNotFoundError:
        return []
    except (OSError, ValueError, KeyError, TypeError, csv.Error) as error:
        raise CheckpointError(f"{path} is no file of metrics ({error}); move it away") from error
    return rows


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
