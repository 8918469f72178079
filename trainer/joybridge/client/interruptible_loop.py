"""The event loop of all sessions. It runs only while one of them sends or waits.

A loop that always ran in a thread of its own would hand every message from thread to thread, which is slower.
Three kinds of callers use it:

- A thread without an event loop, such as the main thread of a program: `run` runs the loop right there.
- A thread inside another event loop, such as a notebook's: asyncio does not nest loops, so `run` runs this one in a
  helper thread and waits for it.
- A finalizer: the garbage collector may call it at any point of any thread, even in the middle of `run`.
  `run_soon` therefore never waits for the loop. If the loop is in use, the work is left to it.

Python handles an interrupt (SIGINT) in the main thread, between any two instructions. An exception raised there while
the loop runs may be lost: gRPC's callbacks and destructors discard exceptions. So from the beginning to the end of
`run` in the main thread an interrupt only cancels the work, and KeyboardInterrupt is raised at the end.
`asyncio.Runner.run` does nearly the same, but loses an interrupt that comes while the work ends, and it sets the signal
handler in every run, which takes longer than the run itself. Here the handler is set once and stays; while `run` is
not running, it does what Python's own handler does.
"""

import asyncio
import atexit
import signal
import threading
from collections.abc import Callable, Coroutine
from concurrent.futures import Future, ThreadPoolExecutor
from types import FrameType
from typing import Any, TypeVar, TypeVarTuple

from joybridge.client.signals import POLL_SECONDS

__all__ = ["EVENT_LOOP", "EventLoop"]

Arguments = TypeVarTuple("Arguments")
T = TypeVar("T")


class EventLoop:
    """An asyncio event loop that runs while a caller waits for work. An interrupt ends the wait."""

    def __init__(self) -> None:
        self._runner = asyncio.Runner(loop_factory=asyncio.new_event_loop)  # makes the loop when it is first needed
        self._helper = ThreadPoolExecutor(1)  # starts its thread when it is first needed
        self._helper_started = False
        self._lock = threading.Lock()  # held by the caller whose work the loop runs
        self._work: asyncio.Task[Any] | None = None  # what that caller waits for
        self._left: set[asyncio.Task[None]] = set()  # work without a waiting caller; asyncio references tasks weakly
        self._closed = False
        # Written by the main thread only:
        self._holding_interrupts = False
        self._interrupted = False
        atexit.register(self._close)

    def run(self, function: Callable[[*Arguments], Coroutine[Any, Any, T]], *args: *Arguments) -> T:
        """Call an async function on the loop and return its result.

        An interrupt in the main thread cancels the call and is raised as KeyboardInterrupt. If the program has set
        a SIGINT handler of its own, that handler stays in place.
        """
        with self._lock:
            loop = self._runner.get_loop()
            main = threading.current_thread() is threading.main_thread()
            try:
                if main:
                    self._hold_interrupts()
                self._work = loop.create_task(function(*args))
                result: T = self._run_until_complete(loop, self._work)
                return result
            except BaseException:
                if self._work is not None:
                    self._work.cancel()  # nothing is left to cancel, unless the program's own handler raised
                raise
            finally:
                self._work = None  # while interrupts are held back, as destructors discard exceptions
                if main:
                    self._release_interrupts()

    def run_soon(self, function: Callable[[*Arguments], Coroutine[Any, Any, None]], *args: *Arguments) -> None:
        """Call an async function on the loop, or leave that to the loop if it is in use. Finalizers may call this."""
        if self._closed:
            return
        if self._lock.locked():
            self._runner.get_loop().call_soon_threadsafe(lambda: self._leave(function(*args)))
        else:
            self.run(function, *args)

    def _run_until_complete(self, loop: asyncio.AbstractEventLoop, work: asyncio.Task[T]) -> T:
        if not _inside_a_loop():  # no work begins while this RuntimeError is handled: tasks would keep its frames alive
            return loop.run_until_complete(work)
        if not self._helper_started:  # an executor that is interrupted while it starts its thread starts another one
            self._helper.submit(int).result()
            self._helper_started = True
        try:
            return _wait(self._helper.submit(loop.run_until_complete, work))
        except BaseException:  # of the work or of the program's own handler, while the helper still runs the loop
            loop.call_soon_threadsafe(work.cancel)
            self._helper.submit(int).result()  # wait until the helper has finished
            raise

    def _leave(self, work: Coroutine[Any, Any, None]) -> None:
        """Begin work without a caller that waits for it; this runs on the loop."""
        task = asyncio.create_task(work)
        self._left.add(task)
        task.add_done_callback(self._left.discard)

    def _hold_interrupts(self) -> None:
        if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
            signal.signal(signal.SIGINT, self._handle_interrupt)
        self._interrupted = False
        self._holding_interrupts = True

    def _release_interrupts(self) -> None:
        self._holding_interrupts = False
        if self._interrupted:
            raise KeyboardInterrupt from None

    def _handle_interrupt(self, number: int, frame: FrameType | None) -> None:
        """Handle SIGINT."""
        if not self._holding_interrupts:
            signal.default_int_handler(number, frame)  # raises KeyboardInterrupt
        self._interrupted = True
        self._runner.get_loop().call_soon_threadsafe(self._cancel_work)

    def _cancel_work(self) -> None:
        """Cancel the work that was interrupted; this runs on the loop."""
        if self._interrupted and self._work is not None:
            self._work.cancel()

    def _close(self) -> None:
        """Drop unfinished work, such as sessions that were not closed; this runs when the interpreter exits."""
        self._closed = True
        if not self._lock.acquire(blocking=False):
            return  # a daemon thread runs the loop, and ends with the process
        try:
            self._runner.close()
        finally:
            self._lock.release()


def _inside_a_loop() -> bool:
    try:
        asyncio.get_running_loop()
    except RuntimeError:
        return False
    return True


def _wait(future: Future[T]) -> T:
    """Return the result of a future. A signal that wakes nobody is handled after POLL_SECONDS."""
    while True:
        try:
            return future.result(POLL_SECONDS)
        except TimeoutError:
            if future.done():
                return future.result()


EVENT_LOOP = EventLoop()  # shared by all sessions, so that each makes progress while another is waited for
