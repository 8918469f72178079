"""The event loop of all sessions, which runs only while one of them sends or waits.

Compared with gRPC's threads this saves handing every message from thread to thread.
"""

import asyncio
import atexit
import signal
import threading
from collections.abc import Coroutine, Iterator
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import contextmanager
from functools import cache
from types import FrameType
from typing import Any, TypeVar

_ONE_AT_A_TIME = threading.RLock()  # which the garbage collector may want in the middle of `run`
_OUTSIDE = ThreadPoolExecutor(1)

T = TypeVar("T")


class _Interrupts:
    """Lets an interrupt end what runs on the loop, and raises it when the loop rests: gRPC's callbacks would lose it.

    While the loop rests, interrupts do what they always do.
    """

    def __init__(self) -> None:
        self.held = self.came = False
        self.task: asyncio.Task[Any] | None = None  # what runs

    def interrupt(self) -> None:
        self.came = True
        if self.task is not None:
            the_loop().call_soon_threadsafe(self.task.cancel)

    def handle(self, number: int, frame: FrameType | None) -> None:
        if not self.held:
            signal.default_int_handler(number, frame)
        self.interrupt()


_interrupts = _Interrupts()
_left: set[asyncio.Task[Any]] = set()  # what runs when the loop runs next


@cache
def the_loop() -> asyncio.AbstractEventLoop:
    """Return the loop, which is closed when the interpreter ends."""
    loop = asyncio.new_event_loop()

    async def drop_all() -> None:
        left = asyncio.all_tasks() - {asyncio.current_task()}
        for task in left:
            task.cancel()
        await asyncio.gather(*left, return_exceptions=True)

    def end() -> None:
        """Drop the sessions that nobody closed."""
        loop.run_until_complete(drop_all())
        loop.close()

    atexit.register(end)
    return loop


def run(work: Coroutine[Any, Any, T]) -> T:
    """Run it on the loop; from a thread where the caller is inside a loop already, as in a notebook.

    An interrupt cancels it and is raised. Python's handler of interrupts is replaced for that, for good; where the
    program has one of its own, that is left alone.
    """
    try:
        with _ONE_AT_A_TIME:
            return _run_outside(work) if _running() else _run_here(work)
    finally:
        work.close()  # of which nothing is left but where an interrupt came first


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Ignore interrupts in the block, at whose end the program ends anyway."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    handlers = {number: signal.signal(number, signal.SIG_IGN) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler or signal.SIG_DFL)


def finish(work: Coroutine[Any, Any, None]) -> None:
    """Run it, or leave it for later where the loop is running already: the garbage collector calls from anywhere."""
    if _running() is not the_loop():
        run(work)
        return
    task = the_loop().create_task(work)
    _left.add(task)
    task.add_done_callback(_left.discard)


def _running() -> asyncio.AbstractEventLoop | None:
    try:
        return asyncio.get_running_loop()
    except RuntimeError:
        return None


def _run_outside(work: Coroutine[Any, Any, T]) -> T:
    done = _OUTSIDE.submit(_run_here, work)
    try:
        return done.result()
    except KeyboardInterrupt:
        _interrupts.interrupt()
        wait([done])
        _interrupts.came = False
        raise


def _run_here(work: Coroutine[Any, Any, T]) -> T:
    outer = _interrupts.held, _interrupts.task
    main = threading.current_thread() is threading.main_thread()
    if main and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _interrupts.handle)  # not at each run: setting is slow
    _interrupts.held = main
    try:
        _interrupts.task = task = the_loop().create_task(work)
        if _interrupts.came:
            task.cancel()
        return the_loop().run_until_complete(task)
    finally:
        _interrupts.task = task = None  # type: ignore[assignment]  # it goes first: as it does, an interrupt would be lost
        _interrupts.held, _interrupts.task = outer
        if _interrupts.came and not _interrupts.held:
            _interrupts.came = False
            raise KeyboardInterrupt
