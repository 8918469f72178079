"""A first look at a pygame program becomes the spec of a game."""

import os
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from statistics import median
from typing import Any

from joybridge.adapters.pygame_programs.form import Look, make_form, make_look, options_of
from joybridge.adapters.pygame_programs.game import PygameGame
from joybridge.adapters.pygame_programs.players import Played, Players
from joybridge.adapters.pygame_programs.processes import ProgramProcesses, WindowProcess
from joybridge.adapters.pygame_programs.settings import PygameSettings, read_pygame_settings
from joybridge.adapters.pygame_programs.wire import OWN_FOLDER
from joybridge.adapters.settings import AdapterError
from joybridge.contract.spec import choose_options
from joybridge.simulator.batched_game import BatchedGame

LOOK_DECISIONS = 16  # for which the program is watched without input


def adapt(text: str) -> type[BatchedGame]:
    """Return the game for "PROGRAM KEY=VALUE … -- ARGUMENTS". Raises AdapterError and GameError."""
    if not hasattr(os, "fork") or not Path(OWN_FOLDER).parent.is_dir():
        raise AdapterError("pygame programs need Linux: each arena is a fork of the program")
    settings = read_pygame_settings(text)
    processes = ProgramProcesses(replace(settings, flags=settings.flags | {"window": False}))
    try:
        look = make_look(settings, processes.start())
        seconds = _frame_seconds(processes, settings, look)
    except BaseException:
        processes.end()
        raise
    if settings.window:
        processes.end()
        processes = WindowProcess(settings)
    members = {
        "name": settings.name, "description": f"{text}, a program written with pygame.", "options": options_of(look),
        "settings": settings, "look": look, "processes": processes, "frame_seconds": seconds,
    }  # fmt: skip
    game: Any = type("AdaptedGame", (PygameGame,), members)
    return game  # type: ignore[no-any-return]


def _frame_seconds(processes: ProgramProcesses, settings: PygameSettings, look: Look) -> float:
    """Return how long a frame of the program usually is, in its own time. Raises GameError if it soon fails."""
    form = make_form(look, choose_options(options_of(look), {}, settings.name))
    players = Players(processes, form, settings.number("seconds"), 1)
    try:
        times = [players.begin([0], [0])[0].nanoseconds]
        for _ in range(LOOK_DECISIONS):
            players.act(0, bytes(form.act_bytes))
            played: Played = players.receive(0)
            times.append(played.nanoseconds)
            if played.over:
                break
    finally:
        players.end([0])
    frames = [(after - before) / form.interval for before, after in pairwise(times)]
    return median(frames) / 1e9 or 1 / settings.number("fps")
