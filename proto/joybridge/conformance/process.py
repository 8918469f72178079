"""The end of the processes of `joybridge check` and `joybridge doctor`."""

import atexit
import os
import sys
from contextlib import suppress
from typing import NoReturn


def leave(status: int) -> NoReturn:
    """Exit with a status at once, after the exit handlers of Python have run and all output is flushed.

    A normal exit also destroys the global objects of gRPC's C++ library, which waits for its threads and has been seen
    to wait forever. Nothing is lost without it: when the checks are done, their connections and files are closed.
    """
    atexit._run_exitfuncs()
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError):  # nobody reads the output any more
            stream.flush()
    os._exit(status)
