"""Files that are either whole or not there, whatever interrupts their writing."""

import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from joybridge.config.errors import StorageError


def write_atomically(path: Path, data: bytes) -> None:
    """Replace the file at `path` by one with this content; after a crash it holds the old content or the new.

    Raises StorageError; then the old file is unchanged and nothing new is left in the folder.
    """
    temporary = path.with_name(f".{path.name}.new")
    with storing(path):
        try:
            write_synced(temporary, data)
            temporary.replace(path)
        except BaseException:
            with suppress(OSError):
                temporary.unlink(missing_ok=True)
            raise
        sync_folder(path.parent)


@contextmanager
def storing(path: Path) -> Iterator[None]:
    """Raise an OSError of the block as a StorageError that names the file and the next move."""
    try:
        yield
    except OSError as error:
        raise StorageError(
            f"cannot write {error.filename or path}: {error.strerror or error}; "
            "make room or give write permission there, or name another folder"
        ) from error


def write_synced(path: Path, data: bytes) -> None:
    """Write a new file and wait until the disk has it. Raises OSError.

    What was there is removed, and nothing is written through a link that somebody has laid there.
    """
    path.unlink(missing_ok=True)
    with path.open("xb") as file:
        file.write(data)
        file.flush()
        os.fsync(file.fileno())


def sync_folder(folder: Path) -> None:
    """Wait until the disk has the names in a folder; systems that cannot open folders need no such wait."""
    if os.name == "nt":
        return
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
