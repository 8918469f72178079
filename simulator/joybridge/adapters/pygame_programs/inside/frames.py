"""Where a frame of the program ends: the moments at which it may be given input and be observed.

A frame ends when the program shows what it has drawn; when it waits and has shown nothing since it last waited; and
when it asks for events a second time, as programs do that draw only on change.
"""

import asyncio
import threading
import time
from collections.abc import Callable
from functools import partial
from typing import Any

import pygame

from joybridge.adapters.pygame_programs.inside.clock import MILLISECOND, SECOND, Clock
from joybridge.adapters.pygame_programs.inside.display import Refused

THREADED = "the program draws in a thread; only programs that draw in their main thread can be run"
UNASKED_FRAMES = 300  # after which a program counts as ready that has never asked for input


class Frames:
    """The ends of frames. `on_frame` is called at each."""

    def __init__(self, clock: Clock, fps: float, on_frame: Callable[[], None], *, window: bool = False) -> None:
        """Take the place of the functions that show, wait and ask for events.

        fps: of a program that never waits. window: what the program shows is shown.
        """
        self.clock, self.on_frame, self._window = clock, on_frame, window
        self.count = 0
        self._threaded = False  # whether a thread has drawn
        self.asked = False  # whether the program has asked for input
        self._length = round(SECOND / fps)
        self._ended = 0  # time at the last end
        self._shown = False  # since the program last waited
        self._polls: set[object] = set()  # in which ways it has asked for events in this frame
        self._replace_display()
        self._replace_waits()
        self._replace_events()

    @property
    def ready(self) -> bool:
        """Return whether the program has begun to ask for input, so that episodes can begin."""
        return self.asked or self.count > UNASKED_FRAMES

    def end(self) -> None:
        """End a frame."""
        if threading.current_thread() is not threading.main_thread():
            self._threaded = True
            raise RuntimeError(THREADED)  # which ends the thread; the next frame of the main thread ends the program
        if self._threaded:
            raise Refused(THREADED)
        if self.clock.now == self._ended:
            self.clock.forward(self._length)
        self._ended = self.clock.now
        self.clock.readings = 0
        self._polls.clear()
        self.count += 1
        self.on_frame()

    def show(self, real: Callable[..., None], *arguments: Any) -> None:
        """Take the place of flip or update."""
        if pygame.display.get_surface() is None:
            raise pygame.error("video system not initialized")
        if self._window:
            real(*arguments)
        self._shown = True
        self.end()

    def wait(self, nanoseconds: int) -> None:
        """Take the place of everything that waits."""
        shown, self._shown = self._shown, False
        self.clock.forward(nanoseconds)
        if not shown:
            self.end()

    def ask(self, *how: Any) -> None:
        """Note that the program asks for events in some way."""
        self.asked = True
        if how in self._polls:
            self.end()
        self._polls.add(how)

    def _replace_display(self) -> None:
        pygame.display.flip = partial(self.show, pygame.display.flip)
        pygame.display.update = partial(self.show, pygame.display.update)

    def _replace_waits(self) -> None:
        frames, clock = self, self.clock

        class FrameClock:
            """pygame.time.Clock in virtual time."""

            def __init__(self) -> None:
                self._last, self._passed = clock.now, 0

            def tick(self, framerate: float = 0) -> int:
                used = clock.now - self._last - clock.borrowed
                left = round(SECOND / framerate) - used if framerate > 0 else 0
                frames.wait(max(left, 0))
                self._passed = clock.now // MILLISECOND - self._last // MILLISECOND
                self._last = clock.now
                return self._passed

            tick_busy_loop = tick

            def get_time(self) -> int:
                return self._passed

            get_rawtime = get_time

            def get_fps(self) -> float:
                return 1000 / self._passed if self._passed else 0.0

        def wait(milliseconds: int) -> int:
            self.wait(int(milliseconds) * MILLISECOND)
            return max(int(milliseconds), 0)

        def sleep(seconds: float) -> None:
            self.wait(round(seconds * SECOND))

        real_sleep = asyncio.sleep

        async def sleep_task(delay: float, result: Any = None) -> Any:
            if delay > 0:
                sleep(delay)  # time passes for all tasks
            await real_sleep(0)
            return result

        asyncio.sleep = sleep_task
        pygame.time.Clock = FrameClock
        pygame.time.wait = pygame.time.delay = wait
        time.sleep = sleep

    def _replace_events(self) -> None:
        get, poll, peek, clear, pump = (
            getattr(pygame.event, name) for name in ("get", "poll", "peek", "clear", "pump")
        )

        def asking(name: str, real: Callable[..., Any]) -> Callable[..., Any]:
            def ask(*arguments: Any, **options: Any) -> Any:
                self.ask(name, str(arguments), str(options)) if arguments or options else self.ask(name)
                return real(*arguments, **options)

            return ask

        def poll_one() -> Any:
            event = poll()
            if event.type == pygame.NOEVENT:
                self.ask("poll")
            else:
                self.asked = True
            return event

        def wait(timeout: int = 0) -> Any:
            self.asked = True
            limit = self.clock.now + int(timeout or 0) * MILLISECOND
            while (event := poll()).type == pygame.NOEVENT and not (timeout and self.clock.now >= limit):
                self.end()
            return event

        for name, real in (("get", get), ("peek", peek), ("clear", clear), ("pump", pump)):
            setattr(pygame.event, name, asking(name, real))
        pygame.event.poll, pygame.event.wait = poll_one, wait
