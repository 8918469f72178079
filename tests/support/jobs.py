"""Jobs of a grid that are trained in the process of the tests, which have torch loaded already."""

import signal

from joybridge.cli import main as trainer
from joybridge.compare.job import Job


class Ended:
    """A run that was trained in this process."""

    def __init__(self, status: int) -> None:
        self.status = status

    def poll(self) -> int:
        return self.status

    def terminate(self) -> None:
        raise AssertionError("it has ended")

    def wait(self) -> int:
        return self.status


def train_here(job: Job) -> Ended:
    """Train a job with the command that a grid would start, and put back the handlers of signals that it replaces."""
    _, _, _, *arguments = job.command(job.config, job.run)
    arguments.remove("--with-parent")
    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        return Ended(trainer(arguments))
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
