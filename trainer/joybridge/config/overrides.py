"""Command lines that end in overrides of a configuration, "key=value" each."""

import argparse
from collections.abc import Sequence
from typing import Any

from joybridge.config.config_files import DEEPEST, merge, parse_yaml
from joybridge.config.errors import ConfigError


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


def read_overrides(overrides: Sequence[str]) -> dict[str, Any]:
    """Return what "key=value" overrides set, as a file would. Raises ConfigError."""
    data: dict[str, Any] = {}
    for override in overrides:
        key, equals, text = override.partition("=")
        if not equals or not key:
            raise ConfigError(f"override {override!r} is not of the form key=value")
        value, parts = parse_yaml(text, f"override {override!r}: {text!r}"), key.split(".")
        if len(parts) > DEEPEST:
            raise ConfigError(f"the key of an override has {len(parts):,} parts, expected {DEEPEST} at most")
        for part in reversed(parts):
            value = {part: value}
        data = merge(data, value)
    return data
