"""Run a grid of jobs, several at a time, and keep the metrics of the finished ones."""

import time
from collections.abc import Callable, Collection, Sequence
from pathlib import Path

from joybridge.compare.display import Display
from joybridge.compare.job import Job, Process, start
from joybridge.compare.names import ResultName, RunName
from joybridge.compare.table import Results, add_results
from joybridge.config.config import load_config
from joybridge.config.metrics import read_cells
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
    """Add the metrics of a finished run to the table in the folder `results`, up to the job's timesteps.

    Raises FileExistsError instead of replacing the result of another run, which has other rewards.
    """
    interval = load_config(job.config, job.settings()).log_interval
    add_results(results, run_results(job.run, job.name, job.timesteps, interval))


def run_results(run: Path, name: RunName, timesteps: int, interval: int) -> Results:
    """Return what each policy in the folder of a run has reached up to some timesteps.

    interval: timesteps between two rows of metrics.
    """
    paths = sorted(run.glob("metrics-*.csv"))
    return {
        ResultName(name, timesteps, "" if len(paths) == 1 else path.stem.removeprefix("metrics-")): [
            cells for cells in read_cells(path) if float(cells["timesteps"]) // interval <= timesteps // interval
        ]
        for path in paths
    }


def is_kept(job: Job, results: Collection[ResultName]) -> bool:
    """Return whether results have those of a job."""
    return any((name.run, name.timesteps) == (job.name, job.timesteps) for name in results)
