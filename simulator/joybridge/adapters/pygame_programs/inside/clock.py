"""A virtual clock in the place of pygame's and Python's: it stands still while the program computes.

Time passes where the program waits, and by one frame at each end of a frame before which it has not waited.
"""

import datetime
import time
from collections.abc import Callable
from typing import Any, Protocol

import pygame

EPOCH = 1_704_067_200 * 10**9  # nanoseconds of `time.time` at the start: 2024-01-01
MILLISECOND = 10**6  # nanoseconds
SECOND = 10**9  # nanoseconds
PATIENCE = 1000  # times that a program may read the clock within a frame before each reading takes a millisecond


class Clock(Protocol):
    """A clock, in nanoseconds."""

    readings: int  # since the last frame
    watchers: list[Callable[[], None]]  # called whenever time has passed
    borrowed: int  # of the time for which the program would wait in this frame, what has passed before it does

    @property
    def now(self) -> int:
        """Return the time since the start of the program."""

    def forward(self, nanoseconds: int) -> None:
        """Let time pass."""

    def patience(self) -> float | None:
        """Return for how many seconds the program may stand still before its frame is late; None: without a limit."""


class RealClock:
    """The time of the world, for a program in its own window."""

    def __init__(self) -> None:
        """Take the place of nothing."""
        self.readings = self.borrowed = 0
        self.spare = 0  # how long the program waited in the last frame: so long others may use the next one
        self.watchers: list[Callable[[], None]] = []
        self._time, self._sleep = time.monotonic_ns, time.sleep
        self._start = self._time()

    @property
    def now(self) -> int:
        """Return the time since the start of the program."""
        return self._time() - self._start

    def forward(self, nanoseconds: int) -> None:
        """Wait, less long where a part of the time has been borrowed."""
        self._sleep(max(nanoseconds - self.borrowed, 0) / SECOND)
        self.spare, self.borrowed = max(nanoseconds, 0), 0
        for watcher in self.watchers:
            watcher()

    def patience(self) -> float:
        """Return for how many seconds the program may stand still: as long as it waited in the last frame."""
        return max(self.spare - self.borrowed - MILLISECOND, 0) / SECOND


class VirtualClock:
    """The time since the start of the program, in nanoseconds, and what is due at a time."""

    def __init__(self) -> None:
        """Take the place of the clocks of Python and of pygame.time.get_ticks."""
        self.now = self.borrowed = 0
        self.readings = 0  # since the last frame
        self.watchers: list[Callable[[], None]] = []  # called whenever time has passed
        self._timers: dict[int, _Timer] = {}  # by event type
        time.time = lambda: (EPOCH + self.read()) / SECOND
        time.time_ns = lambda: EPOCH + self.read()
        for name in ("monotonic", "perf_counter", "process_time", "thread_time"):
            setattr(time, name, lambda: self.read() / SECOND)
            setattr(time, f"{name}_ns", self.read)
        _replace_times()
        _replace_dates()
        pygame.time.get_ticks = lambda: self.read() // MILLISECOND
        pygame.time.set_timer = self.set_timer

    def read(self) -> int:
        """Return the time. A program that does nothing but read it waits, so time must pass."""
        self.readings += 1
        if self.readings > PATIENCE:
            self.forward(MILLISECOND)
        return self.now

    def forward(self, nanoseconds: int) -> None:
        """Let time pass, and post the events of timers that are due."""
        self.now += max(nanoseconds, 0)
        for kind, timer in list(self._timers.items()):
            while timer.due <= self.now and not timer.over:
                timer.post()
            if timer.over:
                self._timers.pop(kind, None)
        for watcher in self.watchers:
            watcher()

    def patience(self) -> None:
        """Return no limit: no time passes while the program stands still."""

    def set_timer(self, event: Any, millis: int, loops: int = 0) -> None:
        """Post an event every so many milliseconds, as pygame.time.set_timer; 0 ends it."""
        if isinstance(event, int):
            event = pygame.event.Event(event)
        self._timers.pop(event.type, None)
        if millis > 0:
            self._timers[event.type] = _Timer(event, self.now, int(millis) * MILLISECOND, int(loops))


class _Timer:
    """An event that is posted again and again."""

    def __init__(self, event: Any, now: int, interval: int, loops: int) -> None:
        self.event, self.interval, self.left = event, interval, loops or -1
        self.due = now + interval

    @property
    def over(self) -> bool:
        return self.left == 0

    def post(self) -> None:
        self.due += self.interval
        self.left -= 1
        post(self.event)


def post(event: Any) -> None:
    """Post an event; one for which the queue has no room is lost, as in pygame."""
    try:
        pygame.event.post(event)
    except pygame.error:  # the queue is full, or there is no display any more
        return


def _replace_times() -> None:
    """Let `time.localtime` and the like tell the virtual time."""
    localtime, gmtime, strftime, asctime = time.localtime, time.gmtime, time.strftime, time.asctime
    time.localtime = lambda seconds=None: localtime(time.time() if seconds is None else seconds)
    time.gmtime = lambda seconds=None: gmtime(time.time() if seconds is None else seconds)
    time.strftime = lambda form, now=None: strftime(form, time.localtime() if now is None else now)
    time.asctime = lambda now=None: asctime(time.localtime() if now is None else now)
    time.ctime = lambda seconds=None: asctime(time.localtime(seconds))


def _replace_dates() -> None:
    """Let `datetime.now` and the like tell the virtual time, in UTC."""

    class VirtualDatetime(datetime.datetime):
        @classmethod
        def now(cls, tz: Any = None) -> Any:
            return cls.fromtimestamp(time.time(), tz or datetime.UTC).replace(tzinfo=tz)

        @classmethod
        def utcnow(cls) -> Any:
            return cls.now()

        @classmethod
        def today(cls) -> Any:
            return cls.now()

    class VirtualDate(datetime.date):
        @classmethod
        def today(cls) -> Any:
            now = VirtualDatetime.now()
            return cls(now.year, now.month, now.day)

    for kind in (VirtualDatetime, VirtualDate):
        kind.__name__ = kind.__qualname__ = kind.__mro__[1].__name__
        kind.__module__ = "datetime"
    datetime.datetime, datetime.date = VirtualDatetime, VirtualDate
