"""The sources of a run that others than we have written: marks of their files, by which a change is noticed.

These are the modules of its game, layout, network and loss, or its pygame program and its hook, and the modules beside
these that they import. A spec does not show that the rules of a game have changed. Nothing is imported or run to make a
mark.
"""

import ast
import hashlib
import json
import shlex
import sys
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from importlib.machinery import ModuleSpec
from importlib.metadata import entry_points
from importlib.util import find_spec
from pathlib import Path
from sysconfig import get_path

from pydantic import TypeAdapter

from joybridge.config.config import Config
from joybridge.config.files import write_atomically
from joybridge.config.json_files import ONLY_FOR_PEOPLE, read_json
from joybridge.contract.files import read_file
from joybridge.layouts.find import GROUP
from joybridge.layouts.mixed import kinds_of
from joybridge.run.own_code import code_of

HOOK = "hook="  # a setting of a pygame program
FILE = "sources.json"  # in the folder of a run
MAX_BYTES = 2**20  # of it
MAX_SOURCE_BYTES = 2**24  # of a file of a source
STANDARD = Path(get_path("stdlib"))


def marks(games: Sequence[str], configs: Sequence[Config]) -> dict[str, str]:
    """Return a mark of the files of each module or program, and of those beside it that it imports.

    They are marked as they are here; those that are not here are left out.

    games: "MODULE:CLASS", "gym:MODULE:ID" or "pygame:PROGRAM" each; the names of others are ignored.
    """
    of_games = [name for game in games for name in _sources_of_game(game)]
    names = {*of_games, *_sources_of(configs)} - {""}
    return {name: mark for name in sorted(_with_imported(names)) if (mark := _mark(name))}


def note_sources(run: Path, games: Sequence[str], config: Config) -> list[str]:
    """Write the marks of a run that is trained now into its folder. Return the sources that have changed since before.

    Raises ConfigError and StorageError.
    """
    before, now = noted_sources(run), marks(games, [config])
    if now:
        write_atomically(run / FILE, json.dumps(now, indent=1).encode())
    return _changed(before, now)


def changed_sources(run: Path, games: Sequence[str], config: Config) -> list[str]:
    """Return the sources whose files are others here than when the run was last trained. Raises ConfigError."""
    before = noted_sources(run)
    return _changed(before, marks(games, [config])) if before else []


def _changed(before: Mapping[str, str], now: Mapping[str, str]) -> list[str]:
    return [name for name, mark in now.items() if before.get(name, mark) != mark]


def noted_sources(run: Path) -> dict[str, str]:
    """Return the marks in the folder of a run, none if it has no others' sources. Raises ConfigError."""
    return read_json(run / FILE, TypeAdapter(dict[str, str]), MAX_BYTES, ONLY_FOR_PEOPLE) or {}


def _sources_of_game(place: str) -> list[str]:
    """Return the modules or the files of a game, nothing for an environment whose package has a version."""
    kind, _, rest = place.partition(":")
    if kind == "pygame":
        with suppress(ValueError):
            program, *settings = shlex.split(rest)
            return [program, *(word.removeprefix(HOOK) for word in settings if word.startswith(HOOK))]
    if kind == "gym":
        return [rest.split(" ")[0].rpartition(":")[0]]
    return [] if kind in ("pygame", "pettingzoo", "unity", "unity-port") else [kind]


def _sources_of(configs: Sequence[Config]) -> set[str]:
    """Return the modules of layouts, networks and losses that are not ours."""
    layouts = {kind for each in configs for kind in kinds_of(each.layout)}
    points = {point.name: point.module for point in entry_points(group=GROUP)}
    named = {name.partition(":")[0] for each in configs for name in code_of(each)}
    return named | {points[name] for name in layouts & set(points)}


def _with_imported(names: set[str]) -> set[str]:
    """Return names of modules and programs, and of what they import, directly or not, from the folder they lie in."""
    found, new = set(names), set(names)
    while new:
        new = {each for name in new for each in _imported(name)} - found
        found |= new
    return found


def _imported(name: str) -> set[str]:
    """Return the modules beside a module, package or program that it imports: paths, as it is one, or names."""
    path = name.endswith(".py") or Path(name).is_dir()
    folder = Path(name).parent if path else _folder(name)
    if folder is None:
        return set()
    found: set[str] = set()
    for file in _files(name):
        try:
            nodes = list(ast.walk(ast.parse(read_file(file, MAX_SOURCE_BYTES))))
        except (OSError, ValueError, SyntaxError, RecursionError, MemoryError):
            continue
        found |= {one.name for node in nodes if isinstance(node, ast.Import) for one in node.names}
        found |= {node.module or "" for node in nodes if isinstance(node, ast.ImportFrom) and not node.level}
    modules = {module.partition(".")[0] for module in found} - {name.partition(".")[0]}
    files = {module for module in modules if (folder / f"{module}.py").is_file()}
    packages = {module for module in modules if (folder / module / "__init__.py").is_file()}
    if not path:
        return files | packages
    return {str(folder / f"{module}.py") for module in files} | {str(folder / module) for module in packages}


def _folder(name: str) -> Path | None:
    """Return the folder that holds a module or a package; none if it is installed, and so has a version."""
    found = _spec(name)
    if found is None or not found.origin or not found.origin.endswith(".py"):
        return None
    folder = Path(found.origin).parents[1 if found.submodule_search_locations else 0]
    return None if folder.name in ("site-packages", "dist-packages") or folder == STANDARD else folder


def _mark(name: str) -> str:
    """Return a mark of the files of a module, a package or a program, "" if there is none here."""
    digest, some = hashlib.sha256(), False
    for path in sorted(_files(name)):
        try:
            digest.update(read_file(path, MAX_SOURCE_BYTES))
        except (OSError, ValueError):  # a pipe, or something large, is no source
            continue
        some = True
    return digest.hexdigest()[:16] if some else ""


def _files(name: str) -> Iterable[Path]:
    if name.endswith(".py"):
        return [Path(name)]
    if (folder := Path(name)).is_dir():
        return folder.rglob("*.py")
    found = _spec(name)
    if found is None:
        return []
    if found.submodule_search_locations:
        return [each for folder in found.submodule_search_locations for each in Path(folder).rglob("*.py")]
    return [Path(found.origin)] if found.origin and found.origin.endswith(".py") else []


def _spec(name: str) -> ModuleSpec | None:
    """Return where a module is; of a module in a package its whole package, as finding it would import that."""
    path = [*sys.path]
    sys.path.insert(0, str(Path.cwd()))  # for this search alone
    try:
        return find_spec(name.partition(".")[0])
    except (ImportError, ValueError, AttributeError):
        return None
    finally:
        sys.path[:] = path
