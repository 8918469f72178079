"""Say it when functions are compiled: the first decision and the first update then take long without a sign."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from numba.core import event


class _Listener(event.Listener):  # type: ignore[misc]
    """Says once that something is compiled. What is read from a cache on disk is not."""

    def __init__(self, say: Callable[[str], None]) -> None:
        self._say, self._said = say, False

    def on_start(self, event: event.Event) -> None:
        """Say it at the first function."""
        if not self._said:
            self._said = True
            self._say("compiling for this machine and these settings, a minute or two; this is kept for later runs")

    def on_end(self, event: event.Event) -> None:
        """Do nothing."""


@contextmanager
def announcing(say: Callable[[str], None]) -> Iterator[None]:
    """Call `say` with a line if Numba begins to compile a function in this block."""
    with event.install_listener("numba:compile", _Listener(say)):
        yield
