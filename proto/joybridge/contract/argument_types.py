"""Types of arguments on command lines. Needs no further package."""

import argparse
import math
from collections.abc import Callable
from typing import Any


class Once(argparse.Action):
    """An option that is an error when it is given twice, of which argparse would take the last one in silence."""

    def __call__(
        self,
        parser: argparse.ArgumentParser,
        namespace: argparse.Namespace,
        values: Any,
        option_string: str | None = None,
    ) -> None:
        """Take the value."""
        if getattr(namespace, self.dest) is not None:
            raise argparse.ArgumentError(self, "it is given twice; give it once")
        setattr(namespace, self.dest, values)


def at_least(least: int) -> Callable[[str], int]:
    """Return a function that reads an integer of at least `least`, or raises ArgumentTypeError."""

    def number(text: str) -> int:
        if not text.isdecimal() or int(text) < least:
            raise argparse.ArgumentTypeError(f"got {text!r}, expected an integer of at least {least}")
        return int(text)

    return number


def seconds(text: str) -> float:
    """Return a positive time in seconds. Raises ArgumentTypeError."""
    return _positive(text, "seconds")


def minutes(text: str) -> float:
    """Return a positive time in minutes. Raises ArgumentTypeError."""
    return _positive(text, "minutes")


def _positive(text: str, unit: str) -> float:
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not (math.isfinite(number) and number > 0):
        raise argparse.ArgumentTypeError(f"got {text!r}, expected a positive number of {unit}")
    return number


def share(text: str) -> float:
    """Return a number of 0..1. Raises ArgumentTypeError."""
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not 0.0 <= number <= 1.0:
        raise argparse.ArgumentTypeError(f"got {text!r}, expected a number of 0..1")
    return number
