"""The places of games that are no classes of ours. Both sides take the game's name from one.

They are "pygame:PROGRAM KEY=VALUE … -- ARGUMENTS" and "gym:ID KEY=VALUE …".
"""

import re
import shlex
from collections.abc import Mapping

__all__ = ["GYM", "NAMES", "PYGAME", "environment_name", "program_name", "program_place"]

PYGAME = "pygame:"  # how the place of a program begins
GYM = "gym:"  # how that of an environment of Gymnasium begins
NAMES = {"keys", "buttons"}  # settings that are names with commas between them


def program_name(text: str) -> str:
    """Return the name of the game of a program: the setting `name`, or the last part of FILE, MODULE or PACKAGE:SCRIPT.

    text: the place without "pygame:". Raises ValueError if it has no program or an open quote.
    """
    words = shlex.split(text)
    if not words or words[0] == "--":
        raise ValueError("a program is missing: FILE, MODULE or PACKAGE:SCRIPT")
    settings = words[1 : words.index("--")] if "--" in words else words[1:]
    names = [word.removeprefix("name=") for word in settings if word.startswith("name=")]
    return names[-1] if names else re.split(r"[./:]", words[0].removesuffix(".py"))[-1]


def environment_name(text: str) -> str:
    """Return the name of the game of an environment: its ID, without the module that registers it.

    text: the place without "gym:". Raises ValueError for an open quote.
    """
    return next(iter(shlex.split(text)), "").rpartition(":")[2]


def program_place(keys: Mapping[str, object]) -> str:
    """Return the place of a program whose settings are keys: {pygame: PROGRAM, KEY: VALUE or VALUES, arguments: WORDS}.

    A key without a value, or with an empty list, is as if it were missing, but for names: `keys: []` is no key at all.
    Raises ValueError if `pygame` is missing or has settings of its own.
    """
    values = {key: each if isinstance(each, list) else [] if each is None else [each] for key, each in keys.items()}
    if len(program := values.pop("pygame", [])) != 1:
        raise ValueError("expected one program, as in {pygame: my_game.py}")
    if setting := re.search(r"\s(\w+)=", _text(program[0])):
        key = setting[1]
        raise ValueError(f"the setting {key!r} is a key of its own, as in {{pygame: my_game.py, {key}: …}}")
    arguments = values.pop("arguments", [])
    values |= {key: [""] for key in NAMES & values.keys() if not values[key]}
    words = [_text(program[0]), *(f"{key}={_text(value)}" for key, each in values.items() for value in each)]
    return PYGAME + shlex.join([*words, *(["--", *map(_text, arguments)] if arguments else [])])


def _text(value: object) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)
