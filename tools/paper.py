"""The experiments of the paper: run any part of the grid, and set it beside the original's.

python tools/paper.py run                                    all experiments, seed 0, 3 M transitions each
python tools/paper.py run --experiments shooting_birds/bucket-11 --seeds 0 1 2 --transitions 30000000
python tools/paper.py report                                 results/README.md, from what has finished

Every run is a process of its own. Finished runs are not repeated and interrupted ones go on where they
stopped, so the command may be interrupted and given again at any moment.
"""

import argparse
import signal
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from tools.report import write_report
from trainer.checkpoint import CheckpointError, has_checkpoint, load_checkpoint
from trainer.metrics import read_rows

ROOT = Path(__file__).resolve().parents[1]
GAMES = ("shooting_birds", "beastly_rivals")
LAYOUTS = (
    "bucket-11", "bucket-3", "bucket-41", "threshold-0.0", "threshold-0.1", "threshold-0.5", "multiagent", "hybrid",
)  # fmt: skip
EXPERIMENTS = tuple(f"{game}/{layout}" for game in GAMES for layout in LAYOUTS)
POLL_SECONDS = 1.0


@dataclass(frozen=True)
class Job:
    """One training run of the grid."""

    experiment: str  # a configuration's path under configs/, without ".yaml"
    seed: int
    transitions: int
    folder: Path  # of all runs

    @property
    def name(self) -> str:
        """Return what the run is called."""
        return f"{self.experiment} s{self.seed}"

    @property
    def run(self) -> Path:
        """Return the run's folder."""
        return self.folder / f"{self.experiment}-s{self.seed}"

    def done(self) -> int:
        """Return the transitions of the last row of metrics, or of the checkpoint where it is later."""
        rows = [row for path in self.run.glob("metrics-*.csv") for row in read_rows(path)[-1:]]
        return max((int(row["transitions"]) for row in rows), default=0)

    def finished(self) -> bool:
        """Return whether the run has reached its end."""
        return has_checkpoint(self.run) and load_checkpoint(self.run)[1]["transitions"] >= self.transitions

    def start(self) -> "subprocess.Popen[bytes]":
        """Start or go on with the run; its output goes to log.txt in its folder."""
        self.run.mkdir(parents=True, exist_ok=True)
        command = [
            sys.executable, "-m", "trainer", "train", str(ROOT / "configs" / f"{self.experiment}.yaml"),
            "--run", str(self.run), f"seed={self.seed}", f"stop={self.transitions}",
        ]  # fmt: skip
        if has_checkpoint(self.run):
            command.append("--resume")
        with (self.run / "log.txt").open("ab") as log:
            return subprocess.Popen(command, stdout=log, stderr=subprocess.STDOUT)


def run_grid(jobs: list[Job], parallel: int, results: Path) -> list[Job]:
    """Run the jobs that are not finished, `parallel` at a time; return those that failed.

    The metrics of each are kept in `results` as soon as it is finished. An interruption is passed
    on to the running jobs, which save.
    """
    waiting = [job for job in jobs if not job.finished()]
    for job in set(jobs) - set(waiting):
        keep_results(job, results)
    print(f"{len(jobs)} runs, {len(jobs) - len(waiting)} of them finished already", flush=True)
    running: dict[Job, subprocess.Popen[bytes]] = {}
    failed: list[Job] = []
    bars = Progress(
        TextColumn("{task.description:<36}"), BarColumn(bar_width=24), TextColumn("{task.fields[text]}"),
        TimeElapsedColumn(),
    )  # fmt: skip
    clock = Speed(waiting)
    total = bars.add_task("all", total=max(1, sum(job.transitions for job in waiting)), text="")
    tasks = {}
    try:
        with bars:
            while waiting or running:
                while waiting and len(running) < parallel:
                    job = waiting.pop(0)
                    running[job] = job.start()
                    tasks[job] = bars.add_task(job.name, total=job.transitions, text="")
                time.sleep(POLL_SECONDS)
                for job, process in list(running.items()):
                    bars.update(tasks[job], completed=job.done(), text=f"{job.done() / 1e6:.1f} M")
                    if process.poll() is not None:
                        del running[job]
                        bars.remove_task(tasks[job])
                        if process.returncode:
                            failed.append(job)
                        else:
                            keep_results(job, results)
                        bars.console.print(f"{job.name}: " + ("failed, see log.txt" if process.returncode else "done"))
                done = clock.update()
                bars.update(total, completed=done, text=clock.text())
    finally:
        for process in running.values():
            process.terminate()
        for process in running.values():
            process.wait()
    return failed


class Speed:
    """How fast the whole grid goes, and how long it will still take at that speed."""

    def __init__(self, jobs: list[Job]) -> None:
        """Measure from now on."""
        self.jobs = list(jobs)
        self.begin = time.monotonic()
        self.first = self.done = sum(job.done() for job in jobs)
        self.total = sum(job.transitions for job in jobs)

    def update(self) -> int:
        """Look at all runs; return the transitions that are done."""
        self.done = sum(min(job.done(), job.transitions) for job in self.jobs)
        return self.done

    def text(self) -> str:
        """Return speed and time left, once both can be told."""
        speed = (self.done - self.first) / (time.monotonic() - self.begin)
        if speed <= 0:
            return "measuring"
        left = (self.total - self.done) / speed
        return f"{speed / 1000:.1f} k transitions/s, {left / 3600:.0f} h {left % 3600 / 60:.0f} min left"


def keep_results(job: Job, folder: Path) -> None:
    """Copy the metrics of a finished run to `folder`, one CSV per policy."""
    paths = sorted(job.run.glob("metrics-*.csv"))
    for path in paths:
        policy = "" if len(paths) == 1 else path.stem.removeprefix("metrics")
        target = folder / f"{job.transitions / 1e6:g}M" / f"{job.experiment}-s{job.seed}{policy}.csv"
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(path.read_bytes())


def main() -> int:
    """Run the command line and return its exit status."""
    parser = argparse.ArgumentParser(description="Run the experiments of the paper.")
    commands = parser.add_subparsers(dest="command", required=True)
    run = commands.add_parser("run", help="run experiments; finished ones are not repeated")
    run.add_argument("--experiments", nargs="+", default=EXPERIMENTS, help="paths under configs/; default all")
    run.add_argument("--seeds", nargs="+", type=int, default=[0], help="default 0")
    run.add_argument("--transitions", type=int, default=3_000_000, help="of each run; default %(default)s")
    run.add_argument("--jobs", type=int, default=1, help="runs at a time; one keeps two cores busy")
    run.add_argument("--runs", type=Path, default=Path("runs/paper"), help="default %(default)s")
    run.add_argument("--results", type=Path, default=Path("results"), help="where CSVs are kept; default %(default)s")
    report = commands.add_parser("report", help="write a page about all finished runs")
    report.add_argument("--results", type=Path, default=Path("results"), help="where CSVs are; default %(default)s")
    options = parser.parse_args()
    if options.command == "report":
        write_report(options.results, options.results / "README.md")
        print(options.results / "README.md")
        return 0
    for experiment in options.experiments:
        if not (ROOT / "configs" / f"{experiment}.yaml").exists():
            parser.error(f"there is no configs/{experiment}.yaml; known are {', '.join(EXPERIMENTS)}")
    jobs = [
        Job(experiment, seed, options.transitions, options.runs)
        for seed in options.seeds
        for experiment in options.experiments
    ]
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        failed = run_grid(jobs, options.jobs, options.results)
    except KeyboardInterrupt:
        print("interrupted; the same command goes on from here", file=sys.stderr)
        return 130
    except CheckpointError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    for job in failed:
        print(f"failed: {job.name}, see {job.run / 'log.txt'}", file=sys.stderr)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
