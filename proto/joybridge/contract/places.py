"""The places of programs: "pygame:PROGRAM KEY=VALUE … -- ARGUMENTS". Both sides take the game's name from one."""

import re
import shlex

__all__ = ["PYGAME", "program_name"]

PYGAME = "pygame:"  # how the place of a program begins


def program_name(text: str) -> str:
    """Return the name of the game of a program: the setting `name`, or the last part of FILE, MODULE or PACKAGE:SCRIPT.

    text: the place without "pygame:". Raises ValueError if it has no program or an open quote.
    """
    words = shlex.split(text)
    if not words:
        raise ValueError("a program is missing: FILE, MODULE or PACKAGE:SCRIPT")
    settings = words[1 : words.index("--")] if "--" in words else words[1:]
    names = [word.removeprefix("name=") for word in settings if word.startswith("name=")]
    return names[-1] if names else re.split(r"[./:]", words[0].removesuffix(".py"))[-1]
