"""Which games a server offers: the built-in ones, those of installed packages, and those given with `--game`.

A game's place is "MODULE:CLASS"; the class is a `Game` or a `BatchedGame`. Installed packages register their places
in the entry point group "joybridge.games". The places of environments of other libraries, which `--gym`,
`--pettingzoo`, `--pygame`, `--unity` and `--unity-port` give, are "gym:ID", "pettingzoo:MODULE", "pygame:PROGRAM",
"unity:BUILD" and "unity-port:PORT"; arguments may follow.
"""

import logging
import math
import os
from collections.abc import Iterator, Sequence
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points

from joybridge.contract.errors import JoybridgeError
from joybridge.contract.spec import SpecError, check_spec, choose_options
from joybridge.contract.text import printable
from joybridge.games import BUILT_IN
from joybridge.simulator.batched_game import BatchedGame
from joybridge.simulator.game import Game
from joybridge.simulator.game_adapter import GameAdapter, batched
from joybridge.simulator.workers.game import in_workers
from joybridge.v1 import bridge_pb2 as pb

log = logging.getLogger("simulator")

Catalog = dict[str, type[BatchedGame]]  # by name

ADAPTERS = {  # the function that returns a game
    "gym": "joybridge.adapters.gymnasium:adapt",
    "pettingzoo": "joybridge.adapters.pettingzoo:adapt",
    "pygame": "joybridge.adapters.pygame_programs.adapter:adapt",
    "unity": "joybridge.adapters.unity.adapter:adapt_build",
    "unity-port": "joybridge.adapters.unity.adapter:adapt_port",
}
EXTRA = ("numba", "PIL", "pygame")  # what `pip install 'joybridge[simulator]'` installs


class CatalogError(JoybridgeError):
    """A game cannot be offered. The message names its place and the reason."""


def load_games(places: Sequence[str] = (), workers: int = 0, seconds: float = math.inf) -> Catalog:
    """Return all games by name: at `places`, built-in, and installed. Raises CatalogError for one that is broken.

    Those at `places` come first, so that `doctor` looks at them before its time is over.

    An installed package whose game is broken takes only itself away; a warning says why. workers: processes that step
    the arenas of each one-arena game at `places`; 0 or 1: this process does. seconds: for each answer of a worker.
    """
    if workers > 1 and os.name == "nt":
        raise CatalogError("workers take sockets from the server, which Windows has no way for; leave out --workers")
    games: Catalog = {}
    for place in places:
        game = load_game(place)
        if workers > 1 and issubclass(game, GameAdapter):
            game = in_workers(game, place, workers, seconds)
        _add(games, place, game)
    for place in BUILT_IN.values():
        _add(games, place, load_game(place))
    for point in entry_points(group="joybridge.games"):
        if point.value not in places:  # those are loaded above, where what is broken is an error
            _add_installed(games, point)
    return games


def _add(games: Catalog, place: str, game: type[BatchedGame]) -> None:
    if games.setdefault(game.name, game) is not game:
        raise CatalogError(f"{place}: there is already a game named {game.name!r}; rename this one")


def _add_installed(games: Catalog, point: EntryPoint) -> None:
    try:
        _add(games, point.value, load_game(point.value))
    except CatalogError as error:
        package = point.dist.name if point.dist else "an installed package"
        log.warning("a game of %s is left out: %s", package, printable(str(error)))


def load_game(place: str) -> type[BatchedGame]:
    """Return the game at a place, its specs checked. Raises CatalogError."""
    kind, _, environment = place.partition(":")
    game = _adapt(kind, environment) if kind in ADAPTERS else _import(place)
    if not (isinstance(game, type) and issubclass(game, Game | BatchedGame)):
        raise CatalogError(f"game {place!r} is not a subclass of joybridge.simulator.Game or BatchedGame")
    try:
        served = batched(game) if issubclass(game, Game) else game
        for spec in specs(served):
            check_spec(spec)
    except SpecError as error:
        raise CatalogError(f"game {place!r} has a spec that violates the contract: {error}") from error
    except (Exception, SystemExit) as error:
        raise CatalogError(f"game {place!r} cannot be described: {type(error).__name__}: {error}") from error
    return served


def _adapt(kind: str, environment: str) -> type[Game] | type[BatchedGame]:
    """Return the game that an environment of another library becomes. Raises CatalogError."""
    module, _, function = ADAPTERS[kind].partition(":")
    try:
        adapter = import_module(module)
    except ModuleNotFoundError as error:
        extra = "simulator" if error.name in EXTRA else "gym"
        raise CatalogError(
            f"--{kind} needs the module {error.name}; install it with `pip install 'joybridge[{extra}]'`"
        ) from error
    try:
        return getattr(adapter, function)(environment)  # type: ignore[no-any-return]
    except JoybridgeError as error:
        raise CatalogError(f"--{kind} {environment!r}: {error}") from error
    except (Exception, SystemExit) as error:  # whatever an environment raises
        raise CatalogError(f"--{kind} {environment!r} does not work: {type(error).__name__}: {error}") from error


def _import(place: str) -> object:
    """Return what is at "MODULE:CLASS". Raises CatalogError."""
    module, _, name = place.partition(":")
    try:
        found = import_module(module)
        if name:
            return getattr(found, name)
    except ModuleNotFoundError as error:
        if error.name in EXTRA:
            text = f"needs the module {error.name}; install it with `pip install 'joybridge[simulator]'`"
        elif error.name and f"{module}.".startswith(f"{error.name}."):
            text = f"cannot be imported ({error}); expected MODULE:CLASS, importable from the current folder"
        else:
            text = f"cannot be imported because one of its own imports failed ({error}); install that module"
        raise CatalogError(f"game {place!r} {text}") from error
    except (ImportError, AttributeError, ValueError) as error:
        raise CatalogError(f"game {place!r} cannot be imported ({error}); expected MODULE:CLASS") from error
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # a module may do anything, such as exit
        text = f"raises {type(error).__name__} when it is imported ({error}); mend its module"
        raise CatalogError(f"game {place!r} {text}") from error
    classes = [n for n, kind in vars(found).items() if isinstance(kind, type) and issubclass(kind, Game | BatchedGame)]
    likely = [name for name in classes if vars(found)[name].__module__ == module] or ["CLASS"]
    raise CatalogError(f"game {place!r} names no class; expected MODULE:CLASS, as in {module}:{likely[0]}")


def specs(game: type[BatchedGame]) -> Iterator[pb.GameSpec]:
    """Yield a game's specs: with all options at their defaults, then with each other choice of one option."""
    default = choose_options(game.options, {}, game.name)
    yield game.describe(default)
    for option in game.options:
        for choice in option.choices:
            yield game.describe(default | {option.name: choice})
