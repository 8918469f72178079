"""The signals that end a program: what they do, and how they are held back while a checkpoint is written."""

import os
import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

__all__ = ["interrupt_on_signals", "leaving_on_signals", "uninterrupted", "wait_for_interrupt"]

POLL_SECONDS = 0.1  # of a wait that a signal may not end: Python handles signals in the main thread, between two steps
_SIGNALS = [signal.SIGINT, signal.SIGTERM, *([signal.SIGHUP] if hasattr(signal, "SIGHUP") else [])]


def interrupt_on_signals() -> None:
    """Let SIGINT, SIGTERM and SIGHUP raise KeyboardInterrupt. A program that nohup started keeps ignoring SIGHUP."""
    signal.signal(signal.SIGINT, signal.default_int_handler)  # shells turn it off for programs in the background
    for number in _SIGNALS[1:]:
        if signal.getsignal(number) is not signal.SIG_IGN or number is signal.SIGTERM:
            signal.signal(number, lambda *_: signal.raise_signal(signal.SIGINT))


def wait_for_interrupt() -> None:
    """Do nothing until a signal raises KeyboardInterrupt, in the main thread.

    Python handles signals there alone, and one that another thread has received wakes nobody: hence the short sleeps.
    """
    while True:
        time.sleep(POLL_SECONDS)


@contextmanager
def leaving_on_signals() -> Iterator[None]:
    """Let the signals end the process at once in the block, which imports compiled modules.

    There, an exception would print a traceback of an import, or abort in the code of torch.
    """
    handlers = {number: signal.signal(number, _leave) for number in _SIGNALS if signal.getsignal(number)}
    try:
        yield
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Hold back SIGINT, SIGTERM and SIGHUP in the block; one that came is raised after it.

    Outside the main thread, to which Python delivers signals, do nothing.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    held: list[int] = []
    handlers = {number: signal.signal(number, lambda number, _: held.append(number)) for number in _SIGNALS}
    try:
        yield
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler or signal.SIG_DFL)
        if held:
            signal.raise_signal(held[0])


def _leave(number: int, frame: FrameType | None) -> None:
    os.write(2, b"interrupted\n")
    os._exit(130)
