"""Environments of Gymnasium by their IDs, for trainers that make them without a simulator."""

import sys
from collections.abc import Sequence
from contextlib import closing
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


def check_spaces(environment: str) -> None:
    """Raise ConfigError for an environment that cannot be made, or whose spaces PPO of Stable-Baselines3 does not take.

    environment: "ID" or "MODULE:ID". Stable-Baselines3 is not imported.
    """
    import gymnasium
    from gymnasium import spaces

    taken = (spaces.Box, spaces.Discrete, spaces.MultiDiscrete, spaces.MultiBinary)  # by its MlpPolicy
    try:
        made = gymnasium.make(environment)
    except Exception as error:  # whatever an environment raises, as for a package that it needs
        raise ConfigError(f"--gym {environment!r} does not work: {type(error).__name__}: {error}") from error
    with closing(made) as env:
        for what, space in (("actions", env.action_space), ("observations", env.observation_space)):
            if not isinstance(space, taken):
                raise ConfigError(
                    f"PPO of Stable-Baselines3 takes {what} of {', '.join(kind.__name__ for kind in taken)}, and those "
                    f"of {environment} are of {type(space).__name__}; flatten them in a wrapper that has an ID of its "
                    "own, or leave out --beside"
                )
        seen = env.observation_space  # below: what Stable-Baselines3 calls an image
        bytes3 = isinstance(seen, spaces.Box) and seen.dtype == "uint8" and len(seen.shape) == 3
        if bytes3 and (seen.low == 0).all() and (seen.high == 255).all():
            raise ConfigError(
                f"the observations of {environment} are images, which get convolutions here and none in MlpPolicy; "
                "compare both on numbers, with gymnasium.wrappers.FlattenObservation around it and an ID of its own, "
                "or leave out --beside"
            )
