"""The name of the game at a place: "MODULE:CLASS", "pygame:PROGRAM" or "gym:ID"."""

import sys
from importlib import import_module
from pathlib import Path

from joybridge.config.errors import ConfigError
from joybridge.contract.places import GYM, PYGAME, environment_name, program_name

NAMED = {PYGAME: program_name, GYM: environment_name}  # places whose text says the name


def name_at(place: str) -> str:
    """Return the name of the game at a place; a class is imported. Raises ConfigError."""
    for beginning, name in NAMED.items():
        if place.startswith(beginning):
            try:
                return name(place.removeprefix(beginning))
            except ValueError as error:
                raise ConfigError(f"game {place!r}: {error}") from error
    module, _, attribute = place.partition(":")
    path = [*sys.path]
    sys.path.insert(0, str(Path.cwd()))  # for this import alone: files there shall not take the place of our modules
    try:
        found = getattr(import_module(module), attribute)
    except (ImportError, AttributeError, ValueError) as error:
        raise ConfigError(
            f"game {place!r} cannot be imported ({error}); expected a game's name or MODULE:CLASS; the current folder "
            "is searched first"
        ) from error
    finally:
        sys.path[:] = path
    return class_name(found, place)


def class_name(game: object, place: object) -> str:
    """Return the name of a game class. place: how it was given. Raises ConfigError."""
    name = getattr(game, "name", None)
    if not isinstance(game, type) or not isinstance(name, str):
        raise ConfigError(f"game {place!r} is not a subclass of joybridge.simulator.Game or BatchedGame with a name")
    return name
