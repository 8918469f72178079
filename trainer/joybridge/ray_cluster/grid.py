"""Run jobs on a Ray cluster, each trainer as a process on any machine that has free cores.

The machines need no shared file system. A run's files are copied to its machine when it starts, and back when there
is a new row of metrics or a new checkpoint, so a restart needs the grid's own folder of runs only. TensorBoard's
event files are not copied back. Ray pickles jobs and the bytes of files, nothing else.
"""

import os
import shutil
import subprocess
import tempfile
import time
from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import joybridge
from joybridge.compare.job import Job, lifeline
from joybridge.config.config import dump_config, load_config
from joybridge.ray_cluster.simulators import PRIVATE, import_ray, join_cluster
from joybridge.run.checkpoint import BEST, checkpoints
from joybridge.run.run_lock import PARENT_SECONDS, locked

CORES = 2  # that a run uses
POLL_SECONDS = 0.1

Files = dict[str, bytes]  # path in a run's folder -> content


class Cluster:
    """A Ray cluster on which jobs can be started."""

    def __init__(self, address: str | None, parallel: int) -> None:
        """Connect to the cluster at `address`; None: start one on this machine with cores for `parallel` runs.

        Raises SystemExit if Ray is not installed, no cluster is there, or it refuses the connection.
        """
        if address is None:
            os.environ.update(PRIVATE)  # read when Ray is imported
            self.ray = import_ray()
            self.ray.init("local", num_cpus=CORES * parallel, include_dashboard=False, log_to_driver=False)
        else:
            # The folders of the namespace package, all named joybridge: Ray unpacks each at a place of its own, and
            # Python joins them again.
            self.ray = join_cluster(address, runtime_env={"py_modules": list(joybridge.__path__)})

    def room(self) -> int:
        """Return how many runs the cluster has cores for at the same time, at least one."""
        return max(1, int(self.ray.cluster_resources().get("CPU", 0)) // CORES)

    def start(self, job: Job) -> "RemoteRun":
        """Start or resume a run on the cluster. Raises RunLockedError if another process is training the run."""
        return RemoteRun(self.ray, job)


class RemoteRun:
    """A run on the cluster, with the methods of a process."""

    def __init__(self, ray: Any, job: Job) -> None:
        """Start the run with the files in the run's folder. Raises RunLockedError."""
        self.ray, self.job = ray, job
        self.lock = ExitStack()
        self.lock.enter_context(locked(job.run, PARENT_SECONDS))
        worker = ray.remote(num_cpus=CORES)(Worker)
        self.worker = worker.remote(job, dump_config(load_config(job.config)), read_files(job.run))
        self.answer = self.worker.poll.remote()
        self.status: int | None = None

    def poll(self) -> int | None:
        """Copy new files back. Return the exit status, or None while the run is going on."""
        if self.status is not None or not self.ray.wait([self.answer], timeout=0)[0]:
            return self.status
        try:
            self.status, files = self.ray.get(self.answer)
            write_files(self.job.run, files)
        except self.ray.exceptions.RayError as error:  # the machine is gone, or the trainer could not be started
            self.status = 1
            with (self.job.run / "log.txt").open("a") as log:
                log.write(f"\nlost on the cluster: {str(error).splitlines()[-1]}\n")
        if self.status is None:
            self.answer = self.worker.poll.remote()
        else:
            self.ray.kill(self.worker)
            self.lock.close()
        return self.status

    def terminate(self) -> None:
        """Ask the run to save a checkpoint and end."""
        self.worker.terminate.remote()

    def wait(self) -> int:
        """Wait for the end and return the exit status."""
        while (status := self.poll()) is None:
            time.sleep(POLL_SECONDS)
        return status


class Worker:
    """The part of a run on the cluster's machine: a trainer process in a temporary folder."""

    def __init__(self, job: Job, config: str, files: Files) -> None:
        """Start the trainer. config: the whole configuration as YAML; files: those of the run so far."""
        self.folder = tempfile.TemporaryDirectory(prefix="joybridge-")
        self.run, path = Path(self.folder.name, "run"), Path(self.folder.name, "config.yaml")
        path.write_text(config, encoding="utf-8")
        write_files(self.run, files)
        self.sent = _stamp(self.run)
        with (self.run / "log.txt").open("ab") as log:
            self.process = subprocess.Popen(
                job.command(path, self.run), stdin=lifeline(), stdout=log, stderr=subprocess.STDOUT
            )

    def poll(self) -> tuple[int | None, Files]:
        """Return the exit status, None while the trainer is running, and the run's files if they have changed."""
        status, stamp = self.process.poll(), _stamp(self.run)
        if status is None and stamp == self.sent:
            time.sleep(0.5)
            return None, {}
        self.sent, files = stamp, read_files(self.run)
        if status is not None:
            self.folder.cleanup()
        return status, files

    def terminate(self) -> None:
        """Ask the trainer to save a checkpoint and end."""
        self.process.terminate()


def read_files(run: Path) -> Files:
    """Return the checkpoints, metrics, log and configuration of a run, by path in the run's folder.

    The run may be going on. Checkpoints are read first, because metrics may be newer than checkpoints, never older.
    """
    paths = [path for path in (*run.glob("checkpoints/*/*"), *run.glob("*")) if path.is_file()]
    files: Files = {}
    for path in paths:
        try:
            files[path.relative_to(run).as_posix()] = path.read_bytes()
        except FileNotFoundError:  # an old checkpoint that has just been deleted
            continue
    files.pop("lock", None)
    return files


def write_files(run: Path, files: Mapping[str, bytes]) -> None:
    """Write files into a run's folder, in an order that never leaves metrics older than checkpoints.

    A checkpoint appears complete or not at all, and checkpoints that are not in `files` are deleted. Without files,
    nothing changes.
    """
    fresh = run / ".fresh"
    shutil.rmtree(fresh, ignore_errors=True)
    for name, data in files.items():
        path = fresh / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)
    (run / "checkpoints").mkdir(parents=True, exist_ok=True)
    for path in fresh.glob("*"):
        if path.is_file():
            path.replace(run / path.name)
    for path in fresh.glob("checkpoints/*"):
        if path.name == BEST:
            shutil.rmtree(run / "checkpoints" / BEST, ignore_errors=True)
        if not (run / "checkpoints" / path.name).exists():
            path.rename(run / "checkpoints" / path.name)
    for path in checkpoints(run):
        if files and not any(name.startswith(f"checkpoints/{path.name}/") for name in files):
            shutil.rmtree(path)
    shutil.rmtree(fresh, ignore_errors=True)


def _stamp(run: Path) -> tuple[tuple[str, int], ...]:
    """Return a value that changes with each new row of metrics and each new checkpoint."""
    sizes = [(path.name, path.stat().st_size) for path in sorted(run.glob("metrics-*.csv"))]
    return *sizes, *((path.name, 0) for path in sorted(run.glob("checkpoints/[0-9]*")))
