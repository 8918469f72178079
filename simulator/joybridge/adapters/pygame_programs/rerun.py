"""A program that is opened to be played by itself, outside of a server."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import numpy as np

from joybridge.adapters.pygame_programs.adapter import adapt
from joybridge.adapters.pygame_programs.form import Form
from joybridge.adapters.pygame_programs.game import PygameGame
from joybridge.adapters.pygame_programs.tape import Rerun
from joybridge.contract.spec import choose_options

HOLD = 0.8  # probability with which random play goes on with what it does


@contextmanager
def opened(program: str, options: Mapping[str, str]) -> Iterator[tuple[Rerun, type[PygameGame]]]:
    """Yield an arena of "PROGRAM KEY=VALUE … -- ARGUMENTS", and its game. Raises AdapterError and GameError."""
    game: Any = adapt(program)
    try:
        yield Rerun(game.processes, game.look, choose_options(game.options, options, game.name)), game
    finally:
        game.processes.end()


def random_acts(form: Form, seed: int, decisions: int) -> Iterator[bytes]:
    """Yield acts that go on for a while, as those of a person do."""
    rng = np.random.default_rng(seed)
    axes, counts = len(form.axes()), [len(branch.choices) for branch in form.branches()]
    places, choices = np.zeros(axes, np.float32), np.zeros(len(counts), np.int32)
    for _ in range(decisions):
        fresh = rng.random(axes + len(counts)) > HOLD
        places = np.where(fresh[:axes], rng.uniform(-1, 1, axes), places).astype(np.float32)
        choices = np.where(fresh[axes:], rng.integers(counts), choices).astype(np.int32)
        yield places.tobytes() + choices.tobytes()
