"""Options of `serve` and `list` that belong to the `--pygame` before them: they become settings of its place."""

import argparse
import shlex
from collections.abc import Sequence
from typing import Any

from joybridge.contract.places import PYGAME

SETTINGS = {  # the metavar and the help of each
    "reward": (
        "SOURCE",
        "what pays: by how much the number in a text changes that the program renders, 'Score: (\\d+)'; that a sound "
        "begins, sound:NAME; by how much a variable changes, attr:NAME; each is a reward channel (repeatable)",
    ),
    "done": ("PATTERN", "end an episode when the program renders a text with this pattern (repeatable)"),
    "hook": ("FILE", "a Python file with functions state, reward, done or metrics over the program's main module"),
    "keys": ("KEYS", "the keys that are buttons, as in LEFT,RIGHT,SPACE; default: those in the program's sources"),
}


class _Setting(argparse.Action):
    """Adds KEY=VALUE to the last program."""

    def __call__(
        self, parser: argparse.ArgumentParser, namespace: argparse.Namespace, values: Any, option: str | None = None
    ) -> None:
        if not (namespace.game and namespace.game[-1].startswith(PYGAME)):
            parser.error(f"{option} is for the program in a --pygame before it")
        try:
            words, own = split_arguments(shlex.split(namespace.game[-1].removeprefix(PYGAME)))
        except ValueError as error:
            parser.error(f"{namespace.game[-1]}: {error}")
        place = PYGAME + shlex.join([*words, f"{self.dest}={values}", *(["--", *own] if own else [])])
        namespace.game = [*namespace.game[:-1], place]


def add_program_options(parser: argparse.ArgumentParser) -> None:
    """Add the options to a parser that has --pygame."""
    group = parser.add_argument_group("programs written with pygame", "for the last --pygame before them")
    for name, (metavar, text) in SETTINGS.items():
        group.add_argument(f"--{name}", action=_Setting, metavar=metavar, default=argparse.SUPPRESS, help=text)


def split_arguments(arguments: Sequence[str]) -> tuple[list[str], list[str]]:
    """Return a command line without what follows `--`, and that: the arguments of the last program."""
    words = list(arguments)
    if "--" not in words:
        return words, []
    at = words.index("--")
    return words[:at], words[at + 1 :]


def give_arguments(parser: argparse.ArgumentParser, options: argparse.Namespace, arguments: Sequence[str]) -> None:
    """Add arguments to the place of the last program. Ends with the usage if there is none."""
    if not arguments:
        return
    games = getattr(options, "game", None) or [""]
    if not (isinstance(games, list) and games[-1].startswith(PYGAME)):
        parser.error(f"got {arguments[0]!r} after --, where arguments of the program in the last --pygame stand")
    options.game = [*games[:-1], f"{games[-1]} -- {shlex.join(arguments)}"]
