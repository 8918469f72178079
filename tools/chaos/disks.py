"""Disks that are full, have no inodes left, or are read-only: a sentence, and nothing saved is lost (Linux).

Each is a file system in memory that only the trainer sees, which needs the right to make user namespaces.
"""

import subprocess
import sys
from pathlib import Path

from joybridge.run.checkpoint import load_checkpoint
from tools.chaos.outcome import Outcome
from tools.chaos.training import CONFIG, SETTINGS

DISKS = {
    "full": "mount -t tmpfs -o size=600k tmpfs {disk}",
    "without inodes": "mount -t tmpfs -o nr_inodes=18 tmpfs {disk}",
    "read-only": "mount -t tmpfs tmpfs {disk} && mount -o remount,ro {disk}",
}
# What is on the disk is copied: nobody else sees it.
SCRIPT = 'set -e; {mount}; status=0; "$@" || status=$?; cp -a {disk}/. {copy}/; exit $status'


def disks(folder: Path, faults: int) -> Outcome:
    """Train on a disk that gets full, one without inodes and one that is read-only, so many times."""
    problems: list[str] = []
    figures: list[str] = []
    for name, mount in [*DISKS.items()] * faults:
        disk, copy = folder / "disk", folder / f"copy-{len(figures)}"
        disk.mkdir(exist_ok=True)
        copy.mkdir()
        script = SCRIPT.format(mount=mount.format(disk=disk), disk=disk, copy=copy)
        train = [
            sys.executable,
            "-m",
            "joybridge",
            "train",
            CONFIG,
            *SETTINGS,
            "keep_checkpoints=1000",
            "--run",
            f"{disk}/run",
        ]
        done = subprocess.run(
            ["unshare", "-rm", "sh", "-c", script, "sh", *train, "stop_at=96000"],
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            check=False,
        )
        errors = [line for line in done.stderr.splitlines() if line.startswith("error: ")]
        if done.returncode != 1 or len(errors) != 1 or "Traceback" in done.stderr:
            problems.append(f"{name}: status {done.returncode}, {done.stderr[-300:]!r}")
        saved = 0
        if (copy / "run/checkpoints").exists():
            saved = load_checkpoint(copy / "run")[1].timesteps
            if (copy / "run/checkpoints/.new").exists():
                problems.append(f"{name}: half of a checkpoint is left")
        figures.append(f"{name}: ended after {saved:,} timesteps, all saved")
    return Outcome(len(figures), problems, ", ".join(figures))
