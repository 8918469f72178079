"""A first look at a pygame program becomes the spec of a game."""

import logging
import os
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from joybridge.adapters.pygame_programs.first_play import Number
from joybridge.adapters.pygame_programs.form import make_look, options_of
from joybridge.adapters.pygame_programs.game import PygameGame
from joybridge.adapters.pygame_programs.processes import ProgramProcesses, WindowProcess
from joybridge.adapters.pygame_programs.remembered import recall_or_play
from joybridge.adapters.pygame_programs.settings import read_pygame_settings
from joybridge.adapters.pygame_programs.wire import OWN_FOLDER
from joybridge.adapters.settings import AdapterError
from joybridge.contract.limits import MAX_DESCRIPTION
from joybridge.contract.text import printable
from joybridge.simulator.batched_game import BatchedGame

log = logging.getLogger("simulator")


def adapt(text: str) -> type[BatchedGame]:
    """Return the game for "PROGRAM KEY=VALUE … -- ARGUMENTS". Raises AdapterError and GameError."""
    if not hasattr(os, "fork") or not Path(OWN_FOLDER).parent.is_dir():
        raise AdapterError("pygame programs need Linux: each arena is a fork of the program")
    settings = read_pygame_settings(text)
    processes = ProgramProcesses(replace(settings, flags=settings.flags | {"window": False}))
    try:
        shown = processes.start()
        found = recall_or_play(processes, shown)
        look, note = make_look(settings, shown, found.read), ""
        if "keys" not in settings.names:
            named = make_look(settings, shown).keys
            menu = "" if found.read else ", perhaps because a menu came first"
            note = f" Keys in its sources: {_list(named)}; that it was seen to read: {_list(found.read)}{menu}."
    except BaseException:
        processes.end()
        raise
    note += _numbers(found.numbers)
    for remark in found.remarks:
        log.warning("%s: %s", settings.name, printable(remark))
    if not found.exact:
        note += " Without snapshots, as it does not go on from them with the same pictures."
    if settings.window:
        processes.end()
        processes = WindowProcess(settings)
    members = {
        "name": settings.name,
        "description": _cut(printable(f"{text}, a program written with pygame.{note}")),
        "options": options_of(look),
        "settings": settings,
        "look": look,
        "processes": processes,
        "frame_seconds": found.frame_seconds,
        "exact": found.exact and not settings.window,
        "numbers": found.numbers,
        "end_texts": list(shown["end_texts"]),
    }
    game: Any = type("AdaptedGame", (PygameGame,), members)
    return game  # type: ignore[no-any-return]


def _cut(text: str) -> str:
    """Return a text that is no longer than a description may be."""
    return text if len(text) <= MAX_DESCRIPTION else f"{text[: MAX_DESCRIPTION - 1]}…"


def _list(names: Iterable[str]) -> str:
    return ", ".join(names) or "none"


def _numbers(numbers: Sequence[Number]) -> str:
    """Say what may be a reward."""
    changed = [str(number) for number in numbers if number.low != number.high]
    others = [str(number) for number in numbers if number.low == number.high]
    changing = f" Numbers in its texts that may be rewards: {_list(changed)}." if changed else ""
    return changing + (f" Numbers that have not changed yet: {_list(others)}." if others else "")
