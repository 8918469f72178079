"""With what the runs of a comparison were made: versions, and marks of the sources that others than we have written.

A run that is added later may be of another game under the same name. A spec does not show it; the page says so.
"""

import hashlib
import json
import sys
from collections.abc import Iterable, Sequence
from importlib.metadata import PackageNotFoundError, entry_points, version
from importlib.util import find_spec
from pathlib import Path
from platform import python_version
from typing import NamedTuple

from joybridge.compare.page_parts import escaped
from joybridge.config.config import Config
from joybridge.config.errors import ConfigError
from joybridge.config.files import write_atomically
from joybridge.contract.files import read_file
from joybridge.layouts.find import GROUP
from joybridge.run.origin import commit
from joybridge.run.own_code import code_of

FILE = "made_with.json"  # in the folder of a comparison
MAX_BYTES = 2**20  # of it
PACKAGES = ("joybridge", "torch", "numpy", "numba")


class MadeWith(NamedTuple):
    """What runs that were started together were made with."""

    versions: dict[str, str]
    sources: dict[str, str]  # a mark of the files of each module or program


def note(folder: Path, games: Sequence[str], configs: Sequence[Config]) -> None:
    """Add to the folder what its next runs are made with, once. Raises ConfigError and StorageError.

    games: of the command line, "MODULE:CLASS", "gym:MODULE:ID" or "pygame:PROGRAM" each.
    """
    versions = {"python": python_version()} | {name: found for name in PACKAGES if (found := _version(name))}
    if mark := commit():
        versions["joybridge"] += f" ({mark})"
    names = {*map(_source_of_game, games), *_sources_of(configs)} - {""}
    now = MadeWith(versions, {name: mark for name in sorted(names) if (mark := _mark(name))})
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


def _source_of_game(place: str) -> str:
    """Return the module or the file of a game, "" for an environment whose package has a version."""
    kind, _, rest = place.partition(":")
    if kind == "pygame":
        return rest.split(" ")[0]
    if kind == "gym":
        return rest.split(" ")[0].rpartition(":")[0]
    return "" if kind in ("pettingzoo", "unity", "unity-port") else kind


def _sources_of(configs: Sequence[Config]) -> set[str]:
    """Return the modules of layouts, networks and losses that are not ours."""
    layouts = {part.rpartition("=")[2].strip().partition("-")[0] for each in configs for part in each.layout.split(",")}
    points = {point.name: point.module for point in entry_points(group=GROUP)}
    named = {name.partition(":")[0] for each in configs for name in code_of(each)}
    return named | {points[name] for name in layouts & set(points)}


def _mark(name: str) -> str:
    """Return a mark of the files of a module, a package or a program, "" if there is none here."""
    files = sorted(_files(name))
    digest = hashlib.sha256()
    for path in files:
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16] if files else ""


def _files(name: str) -> Iterable[Path]:
    if name.endswith(".py"):
        return [Path(name)] if Path(name).is_file() else []
    path = [*sys.path]
    sys.path.insert(0, str(Path.cwd()))  # for this search alone
    try:
        found = find_spec(name)
    except (ImportError, ValueError, AttributeError):
        return []
    finally:
        sys.path[:] = path
    if found is None:
        return []
    if found.submodule_search_locations:
        return [each for folder in found.submodule_search_locations for each in Path(folder).rglob("*.py")]
    return [Path(found.origin)] if found.origin and found.origin.endswith(".py") else []
