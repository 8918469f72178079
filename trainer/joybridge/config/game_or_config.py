"""What a command line names where it takes a game or a configuration of one, without the packages of a training."""

from collections.abc import Sequence

from joybridge.config.errors import ConfigError
from joybridge.config.game_settings import GameSettings, read_settings
from joybridge.contract.places import GYM, PYGAME


def game_or_config(what: str, overrides: Sequence[str]) -> tuple[str, GameSettings]:
    """Return the game, or what else is no configuration, and its settings. Raises ConfigError.

    what: a game, or a configuration that has one; parameters that it draws at random keep their defaults. overrides:
    KEY=VALUE, which replace those of the configuration.
    """
    if what.startswith((PYGAME, GYM)) or (not what.endswith((".yaml", ".yml")) and ("/" not in what or ":" in what)):
        return what, read_settings(overrides)
    try:
        from joybridge.config.config_files import find_config, read_yaml
        from joybridge.config.programs import programs_of
    except ModuleNotFoundError as error:
        raise ConfigError(
            f"{what} is a configuration, which needs the module {error.name}; install it with "
            "`pip install 'joybridge[train]'`"
        ) from None
    data = read_yaml(find_config(what))
    game = programs_of(what, overrides).get("game", data.get("game"))
    if not isinstance(game, str):
        raise ConfigError(f"{what}: its game is {game!r}, expected the name of one game; name the game instead")
    parts = [(key, data.get(key)) for key in ("options", "parameters")]
    given = [(f"{key}.{name}", value) for key, part in parts if isinstance(part, dict) for name, value in part.items()]
    fixed = [f"{name}={value}" for name, value in given if not isinstance(value, dict)]
    return game, read_settings([*fixed, *(text for text in overrides if not text.startswith("game"))])
