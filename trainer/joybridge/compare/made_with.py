"""With what the runs of a comparison were made: versions, and marks of the sources that others than we have written.

A run that is added later may be of another game under the same name. A spec does not show it; the page says so.
"""

import json
from collections.abc import Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from platform import python_version
from typing import NamedTuple

from joybridge.compare.page_parts import escaped
from joybridge.config.config import Config
from joybridge.config.errors import ConfigError
from joybridge.config.files import write_atomically
from joybridge.contract.files import read_file
from joybridge.run.origin import commit
from joybridge.run.sources import marks

FILE = "made_with.json"  # in the folder of a comparison
MAX_BYTES = 2**20  # of it
PACKAGES = ("joybridge", "torch", "numpy", "numba")
OF_GAMES = {"gym": ["gymnasium"], "pettingzoo": ["pettingzoo"], "pygame": ["pygame", "pygame-ce"]}  # by kind


class MadeWith(NamedTuple):
    """What runs that were started together were made with."""

    versions: dict[str, str]
    sources: dict[str, str]  # a mark of the files of each module or program


def note(folder: Path, games: Sequence[str], configs: Sequence[Config], more: Sequence[str] = ()) -> None:
    """Add to the folder what its next runs are made with, once. Raises ConfigError and StorageError.

    games: of the command line, "MODULE:CLASS", "gym:MODULE:ID" or "pygame:PROGRAM" each. more: packages besides.
    """
    of_games = [
        name for kind, names in OF_GAMES.items() if any(game.startswith(f"{kind}:") for game in games) for name in names
    ]
    packages = [*PACKAGES, *of_games, *more]
    versions = {"python": python_version()} | {name: found for name in packages if (found := _version(name))}
    if mark := commit():
        versions["joybridge"] += f" ({mark})"
    now = MadeWith(versions, marks(games, configs))
    if now not in (known := read(folder)):
        lines = ",\n".join(json.dumps(each._asdict()) for each in (*known, now))
        write_atomically(folder / FILE, f"[\n{lines}\n]\n".encode())


def read(folder: Path) -> list[MadeWith]:
    """Return what the runs of a comparison were made with, in the order of their starts. Raises ConfigError."""
    path = folder / FILE
    try:
        return [
            MadeWith(dict(each["versions"]), dict(each["sources"])) for each in json.loads(read_file(path, MAX_BYTES))
        ]
    except FileNotFoundError:
        return []
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ConfigError(f"{path} cannot be read ({error}); delete it, it is only for people") from error


def changed_sources(noted: Sequence[MadeWith]) -> list[str]:
    """Return the modules and programs whose files have changed between runs."""
    marks: dict[str, set[str]] = {}
    for each in noted:
        for name, mark in each.sources.items():
            marks.setdefault(name, set()).add(mark)
    return sorted(name for name, found in marks.items() if len(found) > 1)


def made_with_block(noted: Sequence[MadeWith]) -> str:
    """Return the section of the page as Markdown, "" if nothing is known."""
    lines = []
    for versions, sources in noted:
        words = [f"{name} {found}" for name, found in versions.items()]
        words += [f"{name} (files {mark})" for name, mark in sources.items()]
        lines.append(f"- {escaped(', '.join(words))}")
    return "\n".join(["## Made with", "", *lines]) if lines else ""


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return ""
