"""Games that configurations name by their places: "MODULE:CLASS", "gym:ID", or "pygame:PROGRAM".

The settings of a program may also be keys.
"""

import json
import re
import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from joybridge.config.config_files import find_config, merge, read_overrides, read_yaml
from joybridge.config.errors import ConfigError
from joybridge.config.place_names import name_at
from joybridge.contract.places import GYM, PYGAME, program_name, program_place

CLASS = re.compile(r"[A-Za-z_][\w.]*:[A-Za-z_]\w*")  # MODULE:CLASS


def programs_of(config: str, overrides: Sequence[str]) -> dict[str, str]:
    """Return the places of the classes and programs that a configuration names, by the keys that name them.

    config: a file, or the name of an installed one. The value of `game` is "MODULE:CLASS", "gym:ID", "pygame:PROGRAM",
    or a program and its settings as keys: {pygame: PROGRAM, KEY: VALUE}. A file of a program that is not in the
    current folder is looked for beside the configuration. Raises ConfigError.
    """
    path = find_config(config)
    data = merge(read_yaml(path), read_overrides(overrides))
    named = {"game": data.get("game")}
    if isinstance(games := data.get("games"), dict):
        named |= {f"games.{name}.game": one.get("game") for name, one in games.items() if isinstance(one, dict)}
    places = {key: place for key, game in named.items() if (place := _place(game)) is not None}
    return {key: _found(place, path.parent) for key, place in places.items()}


def with_names(places: Mapping[str, str]) -> list[str]:
    """Return overrides that put the games' names where their places are. Raises ConfigError."""
    return with_places({key: name_at(place) for key, place in places.items()})


def with_places(places: Mapping[str, str]) -> list[str]:
    """Return overrides that put the games' places where their names are."""
    return [f"{key}={json.dumps(place, ensure_ascii=False)}" for key, place in places.items()]


def merged_place(program: str, trained: str, forced: Sequence[str], held: Sequence[str]) -> str:
    """Return the place of a program with settings and arguments that it lacks, from the place of a training.

    program: as after --pygame. trained: the place, "" for none. forced, held: settings that count before those behind
    the program, and after them. Raises ConfigError.
    """
    try:
        (name, *own), words = _parts(program)
        (_, *settings), arguments = _parts(trained.removeprefix(PYGAME))
    except ValueError as error:
        raise ConfigError(f"the program {program!r}: {error}") from error
    chosen: list[str] = []
    for group in (forced, own, held, settings):
        keys = {word.partition("=")[0] for word in chosen}
        chosen += [word for word in group if word.partition("=")[0] not in keys]
    return PYGAME + shlex.join([name, *chosen, *(["--", *(words or arguments)] if words or arguments else [])])


def as_trained(program: str, trained: Sequence[str]) -> str:
    """Return the place of a program that takes the part of one of the training, with the settings of that.

    program: its place. trained: places of the training's games, in which that of the same name is looked for, or else
    the only program. Raises ConfigError.
    """
    try:
        names = {program_name(each.removeprefix(PYGAME)): each for each in trained if each.startswith(PYGAME)}
        name = program_name(program.removeprefix(PYGAME))
    except ValueError as error:
        raise ConfigError(f"the program {program!r}: {error}") from error
    if name not in names and len(names) != 1:
        return program
    part = name if name in names else next(iter(names))
    return merged_place(program.removeprefix(PYGAME), names[part], (), [] if part == name else [f"name={part}"])


def _parts(program: str) -> tuple[list[str], list[str]]:
    """Return a program with its settings, and its arguments."""
    words = shlex.split(program)
    at = words.index("--") if "--" in words else len(words)
    return words[:at] or [""], words[at + 1 :]


def _place(game: Any) -> str | None:
    if isinstance(game, dict):
        try:
            return program_place(game)
        except ValueError as error:
            raise ConfigError(f"game: got {game}; {error}") from error
    return game if isinstance(game, str) and (game.startswith((PYGAME, GYM)) or CLASS.fullmatch(game)) else None


def _found(place: str, folder: Path) -> str:
    """Return a place with the files of a program that are in a folder and not in the current one."""
    if not place.startswith(PYGAME):
        return place
    try:
        words = shlex.split(place.removeprefix(PYGAME))
    except ValueError:  # which `with_names` says
        return place
    end = words.index("--") if "--" in words else len(words)
    for at, word in enumerate(words[:end]):
        before = "" if at == 0 else "hook="
        file = word.removeprefix(before)
        if word.startswith(before) and file.endswith(".py") and not Path(file).is_file() and (folder / file).is_file():
            words[at] = f"{before}{folder / file}"
    found = PYGAME + shlex.join(words)
    return found if shlex.split(found) != shlex.split(place) else place
