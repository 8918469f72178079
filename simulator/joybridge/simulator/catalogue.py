"""Which games a server runs: the built-in ones, installed ones and those named on the command line.

A game is named as "module:Class"; installed packages offer theirs in the entry point group
"joybridge.games". The class is a `Game` or a `BatchedGame`.
"""

from collections.abc import Iterator, Sequence
from importlib import import_module
from importlib.metadata import entry_points

from joybridge.contract.spec import SpecError, check_spec, choose_options
from joybridge.games import BUILT_IN
from joybridge.simulator.adapter import batched
from joybridge.simulator.batched_game import BatchedGame
from joybridge.simulator.game import Game
from joybridge.v1 import bridge_pb2 as pb

Catalogue = dict[str, type[BatchedGame]]


class CatalogueError(Exception):
    """A game that cannot be served; the text names it and says why."""


def load_games(extra: Sequence[str] = ()) -> Catalogue:
    """Return the games by name, their specs checked under every choice of an option. Raises CatalogueError."""
    places = [*BUILT_IN.values(), *(point.value for point in entry_points(group="joybridge.games")), *extra]
    games: Catalogue = {}
    for place in places:
        game = load_game(place)
        if game.name in games and games[game.name] is not game:
            raise CatalogueError(f"{place}: a game named {game.name!r} is already there; give this one another name")
        games[game.name] = game
    return games


def load_game(place: str) -> type[BatchedGame]:
    """Return the game at "module:Class", ready for batches. Raises CatalogueError."""
    module_name, _, class_name = place.partition(":")
    try:
        game = getattr(import_module(module_name), class_name)
    except (ImportError, AttributeError, ValueError) as error:
        raise CatalogueError(f"game {place!r} cannot be imported ({error}); name it as module:Class") from error
    if not (isinstance(game, type) and issubclass(game, Game | BatchedGame)):
        raise CatalogueError(f"game {place!r} is not a class derived from joybridge.simulator.game.Game or BatchedGame")
    try:
        served = batched(game) if issubclass(game, Game) else game
        for spec in specs(served):
            check_spec(spec)
    except SpecError as error:
        raise CatalogueError(f"game {place!r} has a spec that breaks the contract: {error}") from error
    except Exception as error:
        raise CatalogueError(f"game {place!r} cannot be described: {type(error).__name__}: {error}") from error
    return served


def specs(game: type[BatchedGame]) -> Iterator[pb.GameSpec]:
    """Yield a game's specs: under its default options, then with one option changed at a time."""
    default = choose_options(game.options(), {}, game.name)
    yield game.describe(default)
    for option in game.options():
        for choice in option.choices:
            yield game.describe(default | {option.name: choice})
