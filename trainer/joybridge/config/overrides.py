"""Command lines that end in overrides of a configuration, "key=value" each."""

import argparse
from collections.abc import Sequence


def split(text: str, separator: str) -> list[str]:
    """Return what is between separators, stripped; those in brackets, braces and double quotes do not separate."""
    parts, depth, quoted = [""], 0, False
    for char in text:
        quoted ^= char == '"'
        depth += 0 if quoted else (char in "[{") - (char in "]}")
        if char == separator and depth <= 0 and not quoted:
            parts.append("")
        else:
            parts[-1] += char
    return [part.strip() for part in parts]


def split_values(text: str) -> list[str]:
    """Return the values of a key between commas."""
    return split(text, ",")


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
