"""The experiments of the paper: run any part of the grid, and set it beside the original's.

python tools/paper.py run --results mine                     all experiments, seed 0, 3 M timesteps each
python tools/paper.py run --results mine --experiments shooting_birds/bucket-11 --seeds 0 1 2 --timesteps 30000000
python tools/paper.py run --results mine --jobs 2 --set groups=1    two at a time, with some key of all configurations
python tools/paper.py run --results mine --backend ray       on a Ray cluster; without --address a local one
python tools/paper.py report --results mine                  a page and its figures, from what has finished

Without --results they are the project's own, results/, to which runs that it lacks may be added.

Every run is a process of its own. Finished runs are not repeated and interrupted ones go on where they
stopped, so the command may be interrupted and given again, alike, at any moment.
"""

import argparse
import signal
import sys
from pathlib import Path

from joybridge.experiments.grid import Job, run_grid, start
from joybridge.trainer.checkpoint import has_checkpoint
from tools.report import write_report
from tools.results import GAMES, LAYOUTS

CONFIGS = Path(__file__).resolve().parents[1] / "configs"
EXPERIMENTS = tuple(f"{game}/{layout}" for game in GAMES for layout in LAYOUTS)


def main() -> int:
    """Run the command line and return its exit status."""
    parser = argparse.ArgumentParser(description="Run the experiments of the paper.")
    commands = parser.add_subparsers(dest="command", required=True)
    run = commands.add_parser("run", help="run experiments; finished ones are not repeated")
    run.add_argument(
        "--experiments", nargs="+", default=EXPERIMENTS, help="paths under --configs; default the paper's and hybrid"
    )
    run.add_argument("--seeds", nargs="+", type=int, default=[0], help="default 0")
    run.add_argument("--timesteps", type=int, default=3_000_000, help="of each run; default %(default)s")
    run.add_argument(
        "--jobs", type=int, help="runs at a time; one keeps two cores busy; default 1, on a cluster all it can"
    )
    run.add_argument(
        "--set", nargs="+", action="extend", default=[], metavar="KEY=VALUE",
        help="of every configuration; where several runs share the cores, groups=1 spares about a third of the work. "
        "What changes the experiment needs --runs and --results of its own",
    )  # fmt: skip
    run.add_argument("--backend", choices=("local", "ray"), default="local", help="where to run; default %(default)s")
    run.add_argument("--address", help="of a running Ray cluster; without, a local one is started and ended")
    run.add_argument("--configs", type=Path, default=CONFIGS, help="folder of configurations; default the project's")
    run.add_argument("--runs", type=Path, default=Path("runs/paper"), help="default %(default)s")
    run.add_argument("--results", type=Path, default=Path("results"), help="where CSVs are kept; default %(default)s")
    report = commands.add_parser("report", help="write a page with figures about all finished runs")
    report.add_argument("--results", type=Path, default=Path("results"), help="where CSVs are; default %(default)s")
    options = parser.parse_args()
    if options.command == "report":
        print(write_report(options.results))
        return 0
    for key, option in {"seed": "--seeds", "stop": "--timesteps"}.items():
        if any(text.split("=")[0] == key for text in options.set):
            parser.error(f"--set {key}=…: give {option} instead")
    jobs = [
        Job(experiment, seed, options.timesteps, options.configs, options.runs, tuple(options.set))
        for seed in options.seeds
        for experiment in options.experiments
    ]
    for job in jobs:
        if not job.config.exists():
            parser.error(f"there is no {job.config}; the paper's experiments are {', '.join(EXPERIMENTS)}")
        if job.kept(options.results) and not has_checkpoint(job.run):
            parser.error(
                f"{job.kept(options.results)[0]} is of a run that is not in {options.runs}; give --results FOLDER to "
                "keep others elsewhere"
            )
    parallel, begin = options.jobs or 1, start
    if options.backend == "ray":
        from joybridge.experiments.cluster import Cluster  # needs the extra `cluster`

        cluster = Cluster(options.address, parallel)
        parallel, begin = options.jobs or cluster.room(), cluster.start
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        failed = run_grid(jobs, parallel, options.results, begin)
    except KeyboardInterrupt:
        print("interrupted; the same command goes on from here", file=sys.stderr)
        return 130
    for job, complaint in failed.items():
        print(f"failed: {job.name}: {complaint}", file=sys.stderr)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
