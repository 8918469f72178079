"""A program that is opened to be played by itself, outside of a server."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from joybridge.adapters.pygame_programs.adapter import adapt
from joybridge.adapters.pygame_programs.game import PygameGame
from joybridge.adapters.pygame_programs.tape import Rerun
from joybridge.contract.spec import choose_options


@contextmanager
def opened(program: str, options: Mapping[str, str]) -> Iterator[tuple[Rerun, type[PygameGame]]]:
    """Yield an arena of "PROGRAM KEY=VALUE … -- ARGUMENTS", and its game. Raises AdapterError and GameError."""
    game: Any = adapt(program)
    try:
        yield Rerun(game.processes, game.look, choose_options(game.options, options, game.name)), game
    finally:
        game.processes.end()
