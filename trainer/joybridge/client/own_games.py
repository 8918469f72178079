"""Your own games: a class, "MODULE:CLASS" or "pygame:PROGRAM", which a simulator in a child process runs."""

import sys
from collections.abc import Sequence

from joybridge.client.client import list_games
from joybridge.config.errors import ConfigError
from joybridge.config.place_names import class_name, name_at

Game = str | type  # a game class, or "MODULE:CLASS"
Games = Game | Sequence[Game]


def choose_game(game: Game, games: Games, simulator: str | None) -> tuple[str, list[str]]:
    """Return the name of `game`, and "MODULE:CLASS" of all games that are not built in or installed.

    Raises ConfigError for a game that the simulator's process cannot import, or if `simulator` is the address of one
    that is running.
    """
    if not isinstance(game, str | type):
        raise ConfigError(f"game is {game!r}, expected a name, a game class or 'MODULE:CLASS'")
    if isinstance(game, str) and game.endswith(".py") and ":" not in game:
        raise ConfigError(f"{game} is a file: name a pygame program pygame:{game}, and a game of your own MODULE:CLASS")
    own = isinstance(game, type) or ":" in game
    further = [games] if isinstance(games, str | type) else list(games)
    places = list(dict.fromkeys(_place(each) for each in ([game, *further] if own else further)))
    if places and simulator is not None:
        raise ConfigError(
            f"{places[0]} cannot be added to the simulator at {simulator}, which is running: start that with "
            f"`joybridge serve --game {places[0]}` and pass the game's name, or leave out the argument simulator"
        )
    if not own:
        return str(game), places
    return (name_at(game) if isinstance(game, str) else class_name(game, game)), places


def _place(game: Game) -> str:
    """Return "MODULE:CLASS" of a game. Raises ConfigError."""
    if isinstance(game, str):
        return game
    module, name = game.__module__, game.__qualname__
    if module == "__main__" or getattr(sys.modules.get(module), name, None) is not game:
        raise ConfigError(
            f"the simulator's process cannot import the game class {module}.{name}: move it to the top level of a "
            "module of its own, for example my_game.py, and import it from there"
        )
    return f"{module}:{name}"


def choose_at(place: str, game: str | None) -> str:
    """Return a game of a running simulator, or the only one that it has. Raises ConfigError and SimulatorError."""
    games = [game] if game else list_games(place)
    if len(games) != 1:
        raise ConfigError(f"the simulator at {place} has {', '.join(games)}; choose one with --game")
    return games[0]
