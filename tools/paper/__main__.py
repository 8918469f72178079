"""Train the paper's experiments, or write the page about the finished runs.

python -m tools.paper run --results mine                            every experiment, seed 0, 3 M timesteps each
python -m tools.paper run --results mine --experiments shooting_birds/bucket-11 --seeds 0 1 2 --timesteps 30000000
python -m tools.paper run --results mine --jobs 2 --set pipeline_groups=1    two runs at a time, one key of all
python -m tools.paper run --results mine --backend ray              on a Ray cluster; without --address a local one
python -m tools.paper report --results mine                         write mine/README.md and its figures

Without --results, the folder is the project's own, results/, and `report` also writes the table in the project's
README. Each run is a process of its own. Finished runs are skipped and interrupted runs are resumed, so the command
may be interrupted at any time and repeated with the same arguments.
"""

import argparse
import signal
import sys
from collections.abc import Sequence
from pathlib import Path

from joybridge.compare import Job, read_table, run_grid, start
from joybridge.compare.grid import is_kept
from joybridge.compare.table import TABLE
from joybridge.config.config_files import FOLDER
from joybridge.config.errors import CheckpointError
from joybridge.ray_cluster.grid import Cluster
from joybridge.run.checkpoint import has_checkpoint
from tools.paper.page import RESULTS, write_report
from tools.paper.runs import GAMES, LAYOUTS

EXPERIMENTS = tuple(f"{game}/{layout}" for game in GAMES for layout in LAYOUTS)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit status."""
    parser = argparse.ArgumentParser(prog="python -m tools.paper", description="Run the experiments of the paper.")
    commands = parser.add_subparsers(dest="command", required=True)
    run = commands.add_parser("run", help="train experiments; finished runs are skipped")
    run.add_argument(
        "--experiments",
        nargs="+",
        default=EXPERIMENTS,
        metavar="GAME/LAYOUT",
        help="configurations below --configs; default: those of the paper, and hybrid",
    )
    run.add_argument("--seeds", nargs="+", type=int, default=[0], metavar="SEED", help="default: 0")
    run.add_argument("--timesteps", type=int, default=3_000_000, help="length of each run; default: %(default)s")
    run.add_argument(
        "--jobs", type=int, help="runs at the same time, each on two cores; default: 1, on a cluster as many as fit"
    )
    run.add_argument(
        "--set",
        nargs="+",
        action="extend",
        default=[],
        metavar="KEY=VALUE",
        help="set keys of every configuration. pipeline_groups=1 saves about a third of the CPU time when several runs "
        "share the cores. Keys that change the experiment need separate --runs and --results",
    )
    run.add_argument("--backend", choices=("local", "ray"), default="local", help="where to run; default: %(default)s")
    run.add_argument("--address", help="address of a running Ray cluster; default: start a local one for this command")
    run.add_argument("--configs", type=Path, default=FOLDER, help="folder of configurations; default: the project's")
    run.add_argument("--runs", type=Path, default=Path("runs/paper"), help="folder of runs; default: %(default)s")
    run.add_argument("--results", type=Path, default=RESULTS, help="folder of results; default: the project's")
    report = commands.add_parser("report", help="write the page and the figures of all finished runs")
    report.add_argument("--results", type=Path, default=RESULTS, help="folder of results; default: the project's")
    options = parser.parse_args(arguments)
    if options.command == "report":
        for path in write_report(options.results):
            print(path)
        return 0
    return _run(options, parser)


def _run(options: argparse.Namespace, parser: argparse.ArgumentParser) -> int:
    """Run the grid that the options describe and return the exit status."""
    for key, option in {"seed": "--seeds", "stop_at": "--timesteps"}.items():
        if any(text.split("=")[0] == key for text in options.set):
            parser.error(f"--set {key}=…: use {option} instead")
    jobs = [
        Job(experiment, seed, options.timesteps, options.configs, options.runs, tuple(options.set))
        for seed in options.seeds
        for experiment in options.experiments
    ]
    try:
        results = read_table(options.results)
    except CheckpointError as error:
        parser.error(str(error))
    for job in jobs:
        if not job.config.exists():
            parser.error(f"there is no {job.config}; the paper's experiments are {', '.join(EXPERIMENTS)}")
        if is_kept(job, results) and not has_checkpoint(job.run):
            parser.error(
                f"{options.results / TABLE} has {job.name} of a run that is not in {options.runs}; use another folder: "
                "--results FOLDER"
            )
    parallel, begin = options.jobs or 1, start
    if options.backend == "ray":
        cluster = Cluster(options.address, parallel)
        parallel, begin = options.jobs or cluster.room(), cluster.start
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        failed = run_grid(jobs, parallel, options.results, begin)
    except KeyboardInterrupt:
        print("interrupted; repeat the same command to resume", file=sys.stderr)
        return 130
    for job, reason in failed.items():
        print(f"failed: {job.name}: {reason}", file=sys.stderr)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
