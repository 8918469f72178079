"""The end of a process in which nothing is left to do."""

import atexit
import os
import signal
import sys
from typing import NoReturn

LOST = 120  # exit status, as of Python: output could not be written


def leave(status: int) -> NoReturn:
    """Exit with a status at once, after the exit handlers of Python have run and all output is flushed.

    A normal exit also destroys the global objects of libraries: PyTorch's take a second, and gRPC waits for its threads
    and has been seen to wait forever. Nothing is lost without it if connections and files are closed. An interrupt ends
    the process at once.
    """
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    atexit._run_exitfuncs()
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except BrokenPipeError:  # nobody reads the output any more
            pass
        except OSError:
            status = status or LOST
    os._exit(status)
