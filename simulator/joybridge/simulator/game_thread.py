"""A thread for the game of each session, so that a game that is slow or hangs does not hold up anybody else.

Python cannot stop a thread. If a game gives no result in time, its thread is abandoned: the session ends, the log shows
where the game is, and an exception is raised in the thread, which ends an endless loop. A thread that hangs outside
Python code stays until the process ends.
"""

import asyncio
import ctypes
import logging
import math
import sys
import threading
import time
import traceback
from collections.abc import Callable
from contextlib import suppress
from queue import SimpleQueue
from typing import Any, TypeVar, TypeVarTuple

log = logging.getLogger("simulator")

Arguments = TypeVarTuple("Arguments")
T = TypeVar("T")


class TakesTooLong(BaseException):  # no Exception, because games catch those
    """Raised in the thread of a game that gives no result in time."""


class GameThread(threading.Thread):
    """Runs the functions of one game, one after the other. It starts with the first one."""

    def __init__(self, seconds: float) -> None:
        """Allow `seconds` per function, which may be infinite."""
        super().__init__(name="game", daemon=True)
        self.seconds = seconds
        self._jobs: SimpleQueue[Callable[[], None] | None] = SimpleQueue()
        self._last: Callable[[], None] | None = None
        self._ended = False

    async def answer(
        self, function: Callable[[*Arguments], T], *args: *Arguments, busy: Callable[[], float] | None = None
    ) -> T:
        """Return the result of a function. Raises TimeoutError if it takes too long, and whatever it raises.

        busy: for a function that also waits for others, the seconds that the game has been at work.
        """
        loop = asyncio.get_running_loop()
        result: asyncio.Future[T] = loop.create_future()
        alarm: asyncio.TimerHandle | None = None
        begin = time.monotonic()

        def look() -> None:
            nonlocal alarm
            left = self.seconds - (busy() if busy is not None else time.monotonic() - begin)
            if left > 0.0:
                alarm = loop.call_later(left, look)
            else:
                self._abandon(result)

        if self.seconds < math.inf:
            look()

        def deliver(value: Any, error: BaseException | None) -> None:
            if alarm is not None:
                alarm.cancel()
            if result.done():  # its session has ended
                return
            if error is None:
                result.set_result(value)
            else:
                result.set_exception(error)

        def job() -> None:
            value, error = None, None
            try:
                value = function(*args)
            except TakesTooLong:
                return
            except Exception as raised:
                error = raised
            with suppress(RuntimeError):  # the event loop has ended
                loop.call_soon_threadsafe(deliver, value, error)

        self._jobs.put(job)
        if self.ident is None:
            self.start()
        return await result

    def end(self, last: Callable[[], None] | None = None) -> None:
        """Let the thread end after the functions that were given to it, and then `last` if it was given any."""
        if last is not None:
            self._last = last
        self._ended = True
        self._jobs.put(None)

    def run(self) -> None:
        """Run the functions; `Thread` calls this in the thread."""
        while True:
            try:
                while (job := self._jobs.get()) is not None:
                    job()
                break
            except TakesTooLong:  # it arrived between two functions, and what was taken from the queue is lost
                if self._ended:
                    break
        if self._last is not None:
            self._last()

    def stack(self) -> str:
        """Return where the thread is, as in a traceback."""
        frame = sys._current_frames().get(self.ident or 0)
        return "".join(traceback.format_stack(frame)).rstrip() if frame else "it has ended"

    def _abandon(self, result: asyncio.Future[Any]) -> None:
        stack = self.stack()
        ctypes.pythonapi.PyThreadState_SetAsyncExc(ctypes.c_ulong(self.ident or 0), ctypes.py_object(TakesTooLong))
        log.error("a game gave no result in %g s; its thread is here:\n%s", self.seconds, stack)
        if not result.done():
            result.set_exception(TimeoutError())


def game_threads() -> list[GameThread]:
    """Return all threads of games that have not ended."""
    return [thread for thread in threading.enumerate() if isinstance(thread, GameThread)]
