"""Command lines that end in overrides of a configuration, "key=value" each."""

import argparse
import re
from collections.abc import Sequence


def split_values(text: str) -> list[str]:
    """Return the values of a key between commas; commas in brackets and braces do not separate them."""
    return [value.strip() for value in re.split(r",(?![^\[{]*[\]}])", text)]


def add_overrides(parser: argparse.ArgumentParser, text: str) -> None:
    """Add the positional arguments to a command, with this help."""
    parser.add_argument("overrides", nargs="*", default=[], metavar="key=value", help=text)


def parse_overrides(parser: argparse.ArgumentParser, arguments: Sequence[str] | None) -> argparse.Namespace:
    """Return the options, with `overrides` also from where argparse does not see them: behind an option."""
    options, rest = parser.parse_known_args(arguments)
    if any(text.startswith("-") for text in rest):
        parser.parse_args(arguments)  # reports what is unknown
    options.overrides = [*options.overrides, *rest]
    return options
