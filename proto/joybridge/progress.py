"""Long steps say how far they are: once in a while, however quickly or slowly they get on."""

import sys
import time
from collections.abc import Callable
from contextlib import suppress

SILENCE_SECONDS = 10.0  # after which a person wonders


def say(text: str) -> None:
    """Print a line on standard error, if anybody is still there."""
    with suppress(OSError):  # the terminal is gone
        print(text, file=sys.stderr, flush=True)


class Progress:
    """Says how far a step is when nothing has been said of it for some seconds."""

    def __init__(self, say: Callable[[str], None] = say, seconds: float = SILENCE_SECONDS) -> None:
        """Begin a step. seconds: of silence."""
        self._say, self._seconds, self._said = say, seconds, time.monotonic()

    def report(self, text: str) -> None:
        """Say how far the step is, if it is time to."""
        if time.monotonic() - self._said >= self._seconds:
            self._say(text)
            self._said = time.monotonic()


def minutes_left(seconds: float) -> str:
    """Return how long it still takes as the end of a line; "" if that is less than half a minute."""
    minutes = round(seconds / 60)
    return f"; about {minutes} min left" if minutes else ""
