"""Grids of training runs, configurations times seeds, on this machine or on a Ray cluster.

Each run is a process of its own. A grid may be interrupted or killed at any time: `run_grid` with the same jobs skips
finished runs and resumes the others from their last checkpoints, with the same results as an uninterrupted grid.

    from pathlib import Path

    from joybridge.compare import Job, run_grid

    jobs = [
        Job(experiment, seed, timesteps=3_000_000, configs=Path("configs"), runs=Path("runs/mine"))
        for seed in range(3)
        for experiment in ("shooting_birds/bucket-11", "shooting_birds/hybrid")
    ]
    failed = run_grid(jobs, parallel=2, results=Path("results"))
    for job, reason in failed.items():
        print(job.name, reason)

The metrics of all finished runs are then in the table `results/runs.csv.xz`, which `read_table` and pandas read. On a
Ray cluster (extra `cluster`):

    from joybridge.ray_cluster.grid import Cluster

    cluster = Cluster("HOST:PORT", parallel=1)  # None instead of the address: start a local cluster
    failed = run_grid(jobs, cluster.room(), Path("results"), cluster.start)
"""

from joybridge.compare.grid import run_grid
from joybridge.compare.job import Job, Process, start
from joybridge.compare.names import ResultName, RunName
from joybridge.compare.table import add_results, read_table

__all__ = ["Job", "Process", "ResultName", "RunName", "add_results", "read_table", "run_grid", "start"]
