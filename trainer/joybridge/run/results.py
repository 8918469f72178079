"""The runs in a folder as a table, and all their metrics as a frame of pandas.

from joybridge.run.results import load

frame = load("runs")  # a row per run, policy and row of metrics
frame.groupby(["game", "layout"]).reward.max()
"""

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from joybridge.config.config import Config
from joybridge.config.differences import flat
from joybridge.config.errors import ConfigError
from joybridge.config.metrics import Row, read_rows
from joybridge.contract.errors import JoybridgeError
from joybridge.run.checkpoint import checkpoints
from joybridge.run.folder import run_config
from joybridge.run.origin import Origin, run_origins

if TYPE_CHECKING:
    import pandas

NAMED = ("game", "layout", "seed")  # keys of the configuration that every row has

__all__ = ["Run", "find_runs", "load", "read_run", "table"]


@dataclass(frozen=True)
class Run:
    """A run, as its folder shows it."""

    path: Path
    config: Config
    timesteps: int  # of the newest checkpoint or row of metrics
    rows: dict[str, list[Row]]  # of metrics, by policy
    origins: list[Origin]  # of its trainings


def find_runs(folder: Path) -> list[Path]:
    """Return the folders of runs in a folder and those below it, by name, including those that have just begun.

    Raises ConfigError if there are none.
    """
    folders = sorted(path.parent for path in folder.rglob("config.yaml"))
    runs = [path for path in folders if (path / "checkpoints").is_dir() or any(path.glob("metrics-*.csv"))]
    if not runs:
        raise ConfigError(f"{folder} holds no run: no folder in it has a config.yaml, and checkpoints or metrics")
    return runs


def read_run(path: Path) -> Run:
    """Return what the folder of a run shows. Raises ConfigError and CheckpointError."""
    saved = checkpoints(path)
    rows = {file.stem.removeprefix("metrics-"): read_rows(file) for file in sorted(path.glob("metrics-*.csv"))}
    reached = [int(each.name) for each in saved[-1:]] + [int(each[-1]["timesteps"]) for each in rows.values() if each]
    return Run(path, run_config(path), max(reached, default=0), rows, run_origins(path))


def load(folder: str | Path) -> "pandas.DataFrame":
    """Return the metrics of all runs in a folder and below it.

    Columns: run (the folder, from here), game, layout, seed, policy, the other keys of the configurations in which the
    runs differ ("hand.delay"), then those of the files of metrics; what a game does not have is NaN, and a name that a
    configuration does not set, such as "policy.network", is "none". Needs pandas:
    `pip install 'joybridge[results]'`. Raises ConfigError and CheckpointError.
    """
    import pandas

    runs = [read_run(path) for path in find_runs(Path(folder))]
    varied = _varied([run.config for run in runs])
    return pandas.DataFrame(
        [row for run, keys in zip(runs, varied, strict=True) for row in _rows(run, Path(folder), keys)]
    )


def _varied(configs: Sequence[Config]) -> list[dict[str, object]]:
    """Return the keys in which configurations differ, but for NAMED, with the values that each has; None: it has none.

    What is no number or text is JSON. A text that is missing is "none", since pandas leaves None out of groups.
    """
    found = [flat(config.model_dump(mode="json", exclude=set(NAMED))) for config in configs]
    named = {key for each in found for key, value in each.items() if isinstance(value, str)}

    def cell(key: str, value: object) -> object:
        if isinstance(value, dict | list):
            return json.dumps(value)
        return "none" if value is None and key in named else value

    texts = [{key: cell(key, value) for key, value in each.items()} for each in found]
    keys = dict.fromkeys(key for each in texts for key in each)
    varied = [key for key in keys if any(each.get(key) != texts[0].get(key) for each in texts)]
    return [{key: each.get(key) for key in varied} for each in texts]


def _rows(run: Run, folder: Path, varied: Mapping[str, object]) -> Iterator[dict[str, object]]:
    about = {"run": run.path.relative_to(folder).as_posix()} | {name: getattr(run.config, name) for name in NAMED}
    for policy, rows in run.rows.items():
        yield from ({**about, "policy": policy, **varied, **row} for row in rows)


def table(folder: Path) -> list[dict[str, str]]:
    """Return a line per run of a folder and below it, as text by column; a damaged run says so. Raises ConfigError."""
    lines = []
    for path in find_runs(folder):
        name = path.relative_to(folder).as_posix()
        try:
            lines.append({"run": name, **_line(read_run(path))})
        except JoybridgeError as error:
            lines.append({"run": name, "game": f"cannot be read: {error}"})
    return lines


def _short(commit: str) -> str:
    """Return the beginning of a commit, or of the mark of an installation, which has no commit."""
    return commit[: len("files-") + 8] if commit.startswith("files-") else commit[:8]


def _line(run: Run) -> dict[str, str]:
    rows = next(iter(run.rows.values()), [])  # of the first policy
    rewards = [row["reward"] for row in rows if "reward" in row]
    origin = run.origins[-1] if run.origins else None
    return {
        "game": run.config.game,
        "layout": run.config.layout,
        "seed": str(run.config.seed),
        "timesteps": f"{run.timesteps:,} of {run.config.end:,}",
        "reward": f"{rewards[-1]:.2f}" if rewards else "",
        "highest": f"{max(rewards):.2f}" if rewards else "",
        "minutes": f"{rows[-1]['seconds'] / 60:.1f}" if rows and "seconds" in rows[-1] else "",
        "made with": f"{origin.joybridge} {_short(origin.commit)}".strip() if origin else "",
    }
