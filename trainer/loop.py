"""The event loop of all sessions, which runs only while one of them sends or waits.

Compared with gRPC's threads this saves handing every message from thread to thread.
"""

import asyncio
import atexit
import signal
import threading
from collections.abc import Coroutine
from concurrent.futures import ThreadPoolExecutor
from functools import cache
from types import FrameType
from typing import Any, TypeVar

_ONE_AT_A_TIME = threading.Lock()
_OUTSIDE = ThreadPoolExecutor(1)

T = TypeVar("T")


class _Interrupts:
    """Lets an interrupt end what runs on the loop, and raises it when the loop rests: gRPC's callbacks would lose it.

    While the loop rests, interrupts do what they always do.
    """

    def __init__(self) -> None:
        self.held = self.came = False
        self.task: asyncio.Task[Any] | None = None

    def handle(self, number: int, frame: FrameType | None) -> None:
        if not self.held:
            signal.default_int_handler(number, frame)
        self.came = True
        if self.task is not None:
            loop().call_soon_threadsafe(self.task.cancel)


_interrupts = _Interrupts()


def hold_interrupts() -> None:
    """Never lose an interrupt from here on, unless somebody else handles them. Once, as setting handlers is slow."""
    if _in_main_thread() and signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _interrupts.handle)


def _in_main_thread() -> bool:
    return threading.current_thread() is threading.main_thread()


@cache
def loop() -> asyncio.AbstractEventLoop:
    """Return the loop."""
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
    """Run it on the loop; from a thread where the caller is inside a loop already, as in a notebook."""
    try:
        with _ONE_AT_A_TIME:
            try:
                asyncio.get_running_loop()
            except RuntimeError:
                return _run_here(work)
            return _OUTSIDE.submit(_run_here, work).result()
    finally:
        work.close()  # of which nothing is left but where an interrupt came first


def _run_here(work: Coroutine[Any, Any, T]) -> T:
    _interrupts.held = _in_main_thread()
    try:
        _interrupts.task = task = loop().create_task(work)
        return loop().run_until_complete(task)
    finally:
        _interrupts.task = task = None  # type: ignore[assignment]  # it goes first: as it does, an interrupt would be lost, too
        _interrupts.held = False
        if _interrupts.came:
            _interrupts.came = False
            raise KeyboardInterrupt
