"""The parser of a command, and types of its arguments. Needs no further package."""

import argparse
import math
from collections.abc import Callable
from typing import Any

SEEDS = 2**64 - 1  # the largest
PORTS = 2**16 - 1


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


def command_parser(prog: str, name: str, text: str) -> tuple[argparse.ArgumentParser, argparse.ArgumentParser]:
    """Return the parser of a command line that begins with a command, and the one of the command, for its arguments.

    text: what the command does.
    """
    parser = argparse.ArgumentParser(prog=prog)
    return parser, parser.add_subparsers(dest="command", required=True).add_parser(name, description=text)


def at_least(least: int, most: float = math.inf) -> Callable[[str], int]:
    """Return a function that reads an integer of `least` to `most`, or raises ArgumentTypeError."""
    expected = f"of at least {least}" if most == math.inf else f"in {least}..{most}"

    def number(text: str) -> int:
        if not text.isdecimal() or not least <= int(text) <= most:
            raise argparse.ArgumentTypeError(f"got {text!r}, expected an integer {expected}")
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
