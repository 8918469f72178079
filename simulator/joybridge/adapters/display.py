"""The display of pygame, of which a process has one: each environment that draws on it finds it as it left it.

Each session plays in a thread of its own, and the arenas of a session take turns, so that others draw on the display
between two calls of an environment.
"""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from threading import Lock
from typing import Any, ClassVar


class Display:
    """What one environment has drawn on the display."""

    _lock: ClassVar[Lock] = Lock()
    _last: ClassVar["Display | None"] = None  # who used the display last, so that it is as they left it

    def __init__(self) -> None:
        """Begin with whatever is there."""
        self._size, self._pixels = (0, 0), b""  # while another has the display

    @contextmanager
    def own(self) -> Iterator[None]:
        """Have the display alone meanwhile, as it was left. Where there is none, nobody waits for anybody."""
        if _surface() is None:
            yield
            return
        with self._lock:
            self._take()
            yield

    def _take(self) -> None:
        """Keep what is there for whom it belongs to, and put back what this one has drawn."""
        last, Display._last = self._last, self
        surface = _surface()
        if last is self or surface is None:
            return
        if last is not None:
            last._size, last._pixels = surface.get_size(), surface.get_buffer().raw
        if self._pixels:
            if surface.get_size() != self._size:
                surface = sys.modules["pygame"].display.set_mode(self._size)
            surface.get_buffer().write(self._pixels, 0)  # a blit is refused while somebody looks at the pixels


def _surface() -> Any:
    """Return the surface of the display, None if there is no display."""
    display = getattr(sys.modules.get("pygame"), "display", None)
    return display.get_surface() if display is not None and display.get_init() else None
