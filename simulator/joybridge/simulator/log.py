"""The log of a simulator, on standard error: a mistake of a game is shown once, not once per arena and session."""

import logging
import sys
import time
from collections.abc import Mapping
from traceback import extract_tb
from typing import Any

from joybridge.contract.text import printable

log = logging.getLogger("simulator")

TRACEBACKS = 64  # that are known to have been shown


def open_log() -> None:
    """Let this process write its log."""
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(Lines("%(asctime)s %(name)s %(levelname)s %(message)s"))
    logging.basicConfig(level=logging.INFO, handlers=[handler])
    logging.raiseExceptions = False  # a game may have closed standard error, and then a log must not end the server


class Lines(logging.Formatter):
    """Escapes control characters, and indents all lines but the first: no text can look like another message.

    A traceback that was shown already is named by its time.
    """

    def __init__(self, form: str) -> None:
        super().__init__(form)
        self._shown: dict[str, str] = {}  # tracebacks, and when each was shown

    def format(self, record: logging.LogRecord) -> str:
        """Return the lines of a message."""
        return "\n  ".join(map(printable, super().format(record).split("\n")))

    def formatException(self, ei: Any) -> str:
        """Return a traceback, or when it was shown."""
        text = super().formatException(ei)
        if text in self._shown:
            return f"(the traceback is that of {self._shown[text]})"
        if len(self._shown) == TRACEBACKS:
            del self._shown[next(iter(self._shown))]
        self._shown[text] = time.strftime("%H:%M:%S")
        return text


def say_failures(game: str, failures: Mapping[int, BaseException]) -> None:
    """Log what arenas have raised in a step, by their numbers: one message for all that failed in the same place."""
    alike: dict[tuple[Any, ...], list[int]] = {}
    for arena, error in failures.items():
        place = [(frame.filename, frame.lineno) for frame in extract_tb(error.__traceback__)]
        alike.setdefault((type(error), *place), []).append(arena)
    for arenas in alike.values():
        where = f"arena {arenas[0]}" if len(arenas) == 1 else f"{len(arenas)} arenas ({', '.join(map(str, arenas))})"
        text = "%s: the game failed in %s; the running episode is cut there and counts as no result"
        log.error(text, game, where, exc_info=failures[arenas[0]])
