"""A first look at a pygame program becomes the spec of a game."""

import os
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

from joybridge.adapters.pygame_programs.first_play import frame_seconds, keys_read, plays_the_same
from joybridge.adapters.pygame_programs.form import make_look, options_of
from joybridge.adapters.pygame_programs.game import PygameGame
from joybridge.adapters.pygame_programs.processes import ProgramProcesses, WindowProcess
from joybridge.adapters.pygame_programs.settings import read_pygame_settings
from joybridge.adapters.pygame_programs.wire import ENDING, OWN_FOLDER
from joybridge.adapters.settings import AdapterError
from joybridge.simulator.batched_game import BatchedGame


def adapt(text: str) -> type[BatchedGame]:
    """Return the game for "PROGRAM KEY=VALUE … -- ARGUMENTS". Raises AdapterError and GameError."""
    if not hasattr(os, "fork") or not Path(OWN_FOLDER).parent.is_dir():
        raise AdapterError("pygame programs need Linux: each arena is a fork of the program")
    settings = read_pygame_settings(text)
    processes = ProgramProcesses(replace(settings, flags=settings.flags | {"window": False}))
    try:
        shown = processes.start()
        look, note = make_look(settings, shown), ""
        if "keys" not in settings.names:
            read = [key for key in keys_read(processes, look, shown["numbers"]) if key not in ENDING]
            named, look = look.keys, make_look(settings, shown, read)
            note = f" Keys in its sources: {_list(named)}; that it was seen to read: {_list(read)}."
        seconds = frame_seconds(processes, look)
        exact = settings.flags.get("snapshots", settings.window or plays_the_same(processes, look))
    except BaseException:
        processes.end()
        raise
    if not exact:
        note += " Without snapshots, as it does not go on from them with the same pictures."
    if settings.window:
        processes.end()
        processes = WindowProcess(settings)
    members = {
        "name": settings.name,
        "description": f"{text}, a program written with pygame.{note}",
        "options": options_of(look),
        "settings": settings,
        "look": look,
        "processes": processes,
        "frame_seconds": seconds,
        "exact": exact and not settings.window,
    }
    game: Any = type("AdaptedGame", (PygameGame,), members)
    return game  # type: ignore[no-any-return]


def _list(names: Iterable[str]) -> str:
    return ", ".join(names) or "none"
