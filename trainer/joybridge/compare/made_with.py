"""With what the runs of a comparison were made: versions, and marks of the sources that others than we have written.

A run that is added later may be of another game under the same name. A spec does not show it; the page says so.
"""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from pydantic import TypeAdapter

from joybridge.config.files import write_atomically
from joybridge.config.json_files import ONLY_FOR_PEOPLE, read_json
from joybridge.run.origin import Origin, run_origins
from joybridge.run.sources import noted_sources

FILE = "made_with.json"  # in the folder of a comparison
MAX_BYTES = 2**20  # of it
PACKAGES = ("torch", "numpy", "numba")
OF_GAMES = {"gym": ["gymnasium"], "pettingzoo": ["pettingzoo"], "pygame": ["pygame", "pygame-ce"]}  # by kind


class MadeWith(NamedTuple):
    """What runs were made with that differ in nothing of it."""

    versions: dict[str, str]
    sources: dict[str, str]  # a mark of the files of each module or program
    machine: str = ""


def packages_of(games: Sequence[str], more: Sequence[str] = ()) -> list[str]:
    """Return the packages that play a part.

    games: of the command line, "MODULE:CLASS", "gym:MODULE:ID" or "pygame:PROGRAM" each. more: packages besides.
    """
    kinds = {game.partition(":")[0] for game in games}
    return [*PACKAGES, *(name for kind, names in OF_GAMES.items() if kind in kinds for name in names), *more]


def made_with(origin: Origin, sources: dict[str, str], packages: Sequence[str]) -> MadeWith:
    """Return what a run was made with, from where it ran, the marks of its sources, and the packages that count."""
    installed = {name.lower().replace("_", "-"): version for name, version in origin.packages.items()}
    joybridge = origin.joybridge + (f" ({origin.commit})" if origin.commit else "")
    versions = {"python": origin.python, "joybridge": joybridge}
    versions |= {name: installed[name] for name in packages if name in installed}
    return MadeWith(versions, sources, f"{origin.processor or origin.system}, {origin.cores} cores")


def note(folder: Path, runs: Sequence[Path], packages: Sequence[str]) -> None:
    """Add to the folder what runs were made with, from what each of them has noted. Raises ConfigError, StorageError.

    Runs that have noted nothing, or are deleted, are left out. packages: as of `packages_of`.
    """
    noted = before = read(folder)
    for run in runs:
        for origin in run_origins(run)[-1:]:
            noted = _together(noted, made_with(origin, noted_sources(run), packages))
    if noted != before:
        lines = ",\n".join(json.dumps(each._asdict()) for each in noted)
        write_atomically(folder / FILE, f"[\n{lines}\n]\n".encode())


def _together(noted: list[MadeWith], new: MadeWith) -> list[MadeWith]:
    """Return what is noted with a run more, in the line of those that differ from it in nothing that both have."""
    for at, each in enumerate(noted):
        alike = (each.versions, each.machine) == (new.versions, new.machine)
        if alike and all(each.sources.get(name, mark) == mark for name, mark in new.sources.items()):
            both = dict(sorted((each.sources | new.sources).items()))
            return [*noted[:at], each._replace(sources=both), *noted[at + 1 :]]
    return [*noted, new]


def read(folder: Path) -> list[MadeWith]:
    """Return what the runs of a comparison were made with, in the order of their starts. Raises ConfigError."""
    return read_json(folder / FILE, TypeAdapter(list[MadeWith]), MAX_BYTES, ONLY_FOR_PEOPLE) or []


def changed_sources(noted: Sequence[MadeWith]) -> list[str]:
    """Return the modules and programs whose files have changed between runs."""
    marks: dict[str, set[str]] = {}
    for each in noted:
        for name, mark in each.sources.items():
            marks.setdefault(name, set()).add(mark)
    return sorted(name for name, found in marks.items() if len(found) > 1)
