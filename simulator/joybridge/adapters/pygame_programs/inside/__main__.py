"""The process of a program: python -m joybridge.adapters.pygame_programs.inside FOLDER.

FOLDER has the server's door, and in `settings.json` which program is to be run, and how.
"""

import faulthandler
import json
import os
import signal
import sys
import traceback
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Any

from joybridge.adapters.pygame_programs.inside.display import Refused
from joybridge.adapters.pygame_programs.inside.places import Places
from joybridge.adapters.pygame_programs.inside.player import Player
from joybridge.adapters.pygame_programs.inside.program import Program, ProgramError, find_program
from joybridge.adapters.pygame_programs.inside.scan import needs_joystick, scan
from joybridge.adapters.pygame_programs.inside.stage import Stage, own_folder
from joybridge.adapters.pygame_programs.inside.stem import copy_beside
from joybridge.adapters.pygame_programs.wire import STACKS, knock

OURS = str(Path(__file__).parent)


def main() -> None:
    """Run the program until the server has no use for this process."""
    base = Path(sys.argv[1])
    settings = json.loads((base / "settings.json").read_text())
    stacks = os.open(base / STACKS, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o600)  # of this process and its forks
    faulthandler.enable(stacks)
    faulthandler.register(signal.SIGALRM, stacks, chain=True)  # a frame that takes too long: its stack, and the end
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)  # nobody waits for forks
    sys.dont_write_bytecode = True
    signal.setitimer(signal.ITIMER_REAL, settings["start"])
    player = Player(knock(str(base), 0))
    folders = own_folder(base)
    folders.enter(folders.own)
    if not settings["window"]:
        os.chdir(folders.own / "work")
    player.enter(Stage(settings, folders, player.on_frame))
    _run(player, settings)


def _run(player: Player, settings: Mapping[str, Any]) -> None:
    """Run the program to its end, however it comes."""
    os._exit = sys.exit
    try:
        player.stage.keep_score()
        player.stage.raise_fences()
        program = find_program(settings["place"], settings["arguments"])
        player.root = program.root
        player.stage.joysticks.plugged = needs_joystick(scan(program.root), settings["joystick"])
        if not settings["window"]:
            _give_own_places(program, player.stage)
        elif program.beside is not None:
            os.chdir(program.beside)
        with suppress(SystemExit):
            program.run()
        player.end()
    except (Refused, ProgramError) as error:
        player.fail(str(error))
    except BaseException as error:
        player.fail(f"{type(error).__name__}: {error}{_place(error.__traceback__)}", traceback.format_exc())


def _give_own_places(program: Program, stage: Stage) -> None:
    """Let a program write beside itself, and in the folder of its package, without a change there."""
    folder = program.beside or program.root
    if not folder.is_dir():  # a module alone, among others
        return
    stage.fences.beside = str(folder.resolve())
    with stage.fences.trusting():
        if program.beside is not None:
            copy_beside(folder, Path.cwd())
        else:
            (stage.folders.own / "package").symlink_to(folder)
        Places(folder, "package" if program.beside is None else "work", stage.folders, stage.fences).take()


def _place(where: TracebackType | None) -> str:
    """Return in which line of the program an error was raised."""
    lines = [one for one in traceback.extract_tb(where) if OURS not in one.filename and "frozen" not in one.filename]
    return f" (line {lines[-1].lineno} of {lines[-1].filename})" if lines else ""


if __name__ == "__main__":
    main()
