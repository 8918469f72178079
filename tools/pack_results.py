"""Add the finished runs in a folder to the table of a study.

python -m tools.pack_results runs/gym results/gym    every run in runs/gym, to results/gym/runs.csv.xz

`joybridge train` makes such runs; grids and comparisons add theirs by themselves. A run's experiment is its path below
the folder, without its seed: runs/gym/cartpole-s0 is a run of cartpole. The command may be repeated.
"""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from joybridge.compare import RunName, add_results
from joybridge.compare.grid import run_results
from joybridge.compare.table import TABLE
from joybridge.config.errors import CheckpointError, ConfigError, StorageError
from joybridge.run.checkpoint import load_checkpoint
from joybridge.run.folder import run_config


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit status: 1 if a run could not be added."""
    parser = argparse.ArgumentParser(prog="python -m tools.pack_results", description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, help="folder of runs, each in a folder EXPERIMENT-sSEED")
    parser.add_argument("study", type=Path, help="folder of the study, whose table the runs are added to")
    options = parser.parse_args(arguments)
    runs = sorted(path.parent for path in options.folder.glob("**/config.yaml"))
    if not runs:
        parser.error(f"{options.folder} has no run, EXPERIMENT-sSEED/config.yaml; name the folder that runs are in")
    status = 0
    for run in runs:
        try:
            pack(run, RunName.parse(run.relative_to(options.folder).as_posix()), options.study)
        except (CheckpointError, ConfigError, StorageError, OSError, ValueError) as error:
            print(f"{run}: {error}", file=sys.stderr)
            status = 1
    print(options.study / TABLE)
    return status


def pack(run: Path, name: RunName, study: Path) -> None:
    """Add a run to the table of a study.

    Raises ValueError for a run that has not ended, CheckpointError and ConfigError for one that cannot be read, and
    FileExistsError for another run of the same name.
    """
    config, timesteps = run_config(run), load_checkpoint(run)[1].timesteps
    if timesteps < config.end:
        raise ValueError(f"it has {timesteps:,} of {config.end:,} timesteps; resume it first")
    add_results(study, run_results(run, name, config.end, config.log_interval))


if __name__ == "__main__":
    sys.exit(main())
