"""One trainer per run: a lock on the run's folder, which ends with the process, however that ends."""

import os
import platform
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path

from filelock import FileLock, Timeout

from joybridge.config.errors import RunLockedError
from joybridge.config.files import storing
from joybridge.contract.files import read_file

PARENT_SECONDS = 10.0  # to wait for the trainers of a program that was killed: they are still saving


@contextmanager
def locked(run: Path, seconds: float = 0.0, option: str = "--run") -> Iterator[None]:
    """Hold the lock of a run's folder, which is made if it does not exist.

    seconds: how long to wait for the lock. option: of the command line, which names the folder. Raises RunLockedError,
    which names the process that holds it, and StorageError.
    """
    path = run / "lock"
    lock = FileLock(path)
    with storing(path):
        run.mkdir(parents=True, exist_ok=True)
        try:
            lock.acquire(timeout=seconds)
        except Timeout:
            raise RunLockedError(
                f"{run} is being trained by {_holder(path)}; end that training, or name another folder with {option}"
            ) from None
        path.write_text(f"process {os.getpid()} on {platform.node()} since {datetime.now():%Y-%m-%d %H:%M:%S}")
    try:
        yield
    finally:
        lock.release()


def _holder(path: Path) -> str:
    """Return what the process that holds the lock has written about itself."""
    try:
        text = read_file(path, 1000).decode()
    except (OSError, ValueError):
        text = ""
    return text if text and text.isprintable() else "another process"
