"""Environments of Gymnasium by their IDs, for trainers that make them without a simulator."""

import sys
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path

from joybridge.config.errors import ConfigError


def environment_of(game: str, given: Sequence[str]) -> str:
    """Return the ID of a game in Gymnasium, with the module that registers it if the command line has --gym MODULE:ID.

    given: games of the command line. Raises ConfigError for one with settings, which the other trainer would not know.
    """
    for text in given:
        environment, *settings = text.removeprefix("gym:").split()
        if text.startswith("gym:") and environment.rpartition(":")[2] == game:
            if settings:
                raise ConfigError(
                    f"--gym {text.removeprefix('gym:')!r}: another trainer gets no settings ({' '.join(settings)}); "
                    "register an environment that has them under an ID of its own"
                )
            return environment
    return game


def is_registered(environment: str) -> bool:
    """Whether Gymnasium has an environment "ID" or "MODULE:ID"; the current folder is searched for the module.

    Raises ConfigError if the module cannot be imported.
    """
    import gymnasium  # of the other trainer

    module, _, name = environment.rpartition(":")
    path = [*sys.path]
    sys.path.insert(0, str(Path.cwd()))
    try:
        if module:
            import_module(module)
    except ImportError as error:
        raise ConfigError(f"--gym {environment!r}: module {module!r} cannot be imported ({error})") from error
    finally:
        sys.path[:] = path
    return name in gymnasium.registry
