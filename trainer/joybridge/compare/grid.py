"""Run a grid of jobs, several at a time, and keep the metrics of the finished ones."""

import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from joybridge.compare.display import Display
from joybridge.compare.job import Job, Process, start
from joybridge.compare.names import ResultName, find_results
from joybridge.config.config import load_config
from joybridge.config.files import write_atomically
from joybridge.config.metrics import Row, read_rows
from joybridge.contract.errors import JoybridgeError

POLL_SECONDS = 0.5
GRACE_SECONDS = 10.0  # for processes to end by themselves after an interrupt


def run_grid(
    jobs: Sequence[Job], parallel: int, results: Path, begin: Callable[[Job], Process] = start
) -> dict[Job, str]:
    """Run the unfinished jobs, `parallel` at a time. Return the failed jobs with the reasons.

    begin: starts a job. The metrics of each job are kept in `results` as soon as it is finished. After an interrupt
    (KeyboardInterrupt) the running jobs save checkpoints, and the next call with the same jobs resumes them.
    """
    finished = [job for job in jobs if job.finished()]
    waiting = [job for job in jobs if job not in finished]
    running: dict[Job, Process] = {}
    failed: dict[Job, str] = {}

    def keep(job: Job) -> None:
        try:
            keep_results(job, results)
        except (OSError, JoybridgeError) as error:
            failed[job] = str(error)

    for job in finished:
        keep(job)
    if not waiting:
        return failed
    display = Display(jobs, finished)
    try:
        with display.live:
            while waiting or running:
                while waiting and len(running) < parallel:
                    job = waiting.pop(0)
                    try:
                        job.prepare()
                        running[job] = begin(job)
                    except (OSError, JoybridgeError) as error:
                        failed[job] = str(error)
                        display.end(job, failed[job])
                for job, process in list(running.items()):
                    status = process.poll()
                    if status is not None:
                        del running[job]
                        if status:
                            failed[job] = job.failure(status)
                        else:
                            keep(job)
                        display.end(job, failed.get(job))
                display.update(list(running))
                time.sleep(POLL_SECONDS)
    finally:
        end(list(running.values()))
    return failed


def end(processes: Sequence[Process]) -> None:
    """End processes and wait until they have saved their checkpoints.

    An interrupt from the terminal has already reached the processes, and a second signal could disturb their saving.
    Therefore only those that are still running after GRACE_SECONDS are terminated.
    """
    deadline = time.monotonic() + GRACE_SECONDS
    while any(process.poll() is None for process in processes) and time.monotonic() < deadline:
        time.sleep(POLL_SECONDS)
    for process in processes:
        if process.poll() is None:
            process.terminate()
    for process in processes:
        process.wait()


def keep_results(job: Job, results: Path) -> None:
    """Copy the metrics of a finished run to the folder `results`, one CSV per policy, up to the job's timesteps.

    Raises FileExistsError instead of replacing the result of another run, which has other rewards.
    """
    paths = sorted(job.run.glob("metrics-*.csv"))
    interval = load_config(job.config, job.settings()).log_interval
    for path in paths:
        policy = "" if len(paths) == 1 else path.stem.removeprefix("metrics-")
        target = results / ResultName(job.name, job.timesteps, policy).path
        rows = [row for row in read_rows(path) if row["timesteps"] // interval <= job.timesteps // interval]
        if target.exists() and _rewards(read_rows(target)) != _rewards(rows):
            raise FileExistsError(f"{target} is the result of another run; move it away or use another folder")
        target.parent.mkdir(parents=True, exist_ok=True)
        lines = path.read_bytes().splitlines(keepends=True)
        write_atomically(target, b"".join(lines[: 1 + len(rows)]))  # 1: the header


def kept_results(job: Job, results: Path) -> list[Path]:
    """Return the files of a job in the folder `results`, one per policy; empty if there is none."""
    wanted = ResultName(job.name, job.timesteps)
    return [path for name, path in find_results(results).items() if replace(name, policy="") == wanted]


def _rewards(rows: Sequence[Row]) -> list[float | None]:
    return [row.get("reward") for row in rows]
