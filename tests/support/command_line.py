"""The command `joybridge` in the process of the tests, which have torch loaded already."""

import io
import signal
from contextlib import redirect_stderr, redirect_stdout
from typing import NamedTuple

from joybridge.cli import main


class Done(NamedTuple):
    """The exit status of a command and what it printed."""

    status: int
    output: str
    errors: str


def joybridge(*arguments: str) -> Done:
    """Run a command, and put back the handlers of signals that it replaces."""
    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    output, errors = io.StringIO(), io.StringIO()
    try:
        with redirect_stdout(output), redirect_stderr(errors):
            status = main(arguments)
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
    return Done(status, output.getvalue(), errors.getvalue())
