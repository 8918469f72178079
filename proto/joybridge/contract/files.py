"""Reading files that somebody else may have put there: it always ends, and takes no more memory than allowed."""

import errno
import os
import stat
from pathlib import Path

__all__ = ["BLOCK_BYTES", "read_file"]

BLOCK_BYTES = 512  # of `st_blocks`
MAX_GROWTH = 100  # bytes of a large file for each that it takes on the disk
LARGE_BYTES = 2**26


def read_file(path: Path, limit: int) -> bytes:
    """Return the content of a regular file of at most `limit` bytes.

    Raises OSError for a larger file, for a device or a pipe, which may have no end, and for a large file that
    consists of holes, which costs whoever sends it nothing.
    """
    descriptor = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0))  # a pipe must not wait for its writer
    try:
        status = os.fstat(descriptor)
        if not stat.S_ISREG(status.st_mode):
            raise OSError(errno.EINVAL, "not a regular file", str(path))
        if status.st_size > limit:
            raise OSError(errno.EFBIG, f"{status.st_size:,} bytes, expected at most {limit:,}", str(path))
        blocks = getattr(status, "st_blocks", status.st_size)  # Windows has none
        if status.st_size > LARGE_BYTES and blocks * BLOCK_BYTES * MAX_GROWTH < status.st_size:
            raise OSError(errno.EFBIG, f"{status.st_size:,} bytes, almost all of them holes", str(path))
        with os.fdopen(descriptor, "rb", closefd=False) as file:
            return file.read(status.st_size)
    finally:
        os.close(descriptor)
