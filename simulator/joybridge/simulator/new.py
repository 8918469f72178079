"""`joybridge new my_game`: begin a game of one's own with a small one that plays and trains."""

import builtins
import os
import re
import shlex
import shutil
import sys
from importlib.machinery import PathFinder
from importlib.util import find_spec
from keyword import iskeyword
from pathlib import Path

import joybridge.simulator.game
from joybridge.games import BUILT_IN

TEMPLATE = Path(__file__).parent / "template"
NAME, CLASS = "my_game", "MyGame"  # in the template, to be replaced
SUFFIXES = (".py", ".yaml")


class NewGameError(Exception):
    """A game that cannot be begun; the text says why, and what to do instead."""


def new_game(name: str, folder: Path) -> str:
    """Write NAME.py and NAME.yaml into a folder, made where there is none; return what to type next.

    Nothing is ever overwritten. Raises NewGameError.
    """
    class_name = "".join(part.capitalize() for part in name.split("_"))
    files = {suffix: folder / f"{name}{suffix}" for suffix in SUFFIXES}
    _check_name(name, class_name)
    for path in files.values():
        if path.exists():
            raise NewGameError(f"{path} is there already and is not overwritten; choose another name or --folder")
    if name in sys.modules or find_spec(name) or PathFinder.find_spec(name, [str(folder)]):
        raise NewGameError(f"there is a module {name!r} already, which {name}.py would hide; try {name}_game")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for suffix, path in files.items():
            text = (TEMPLATE / f"{NAME}{suffix}").read_text(encoding="utf-8")
            with path.open("x", encoding="utf-8") as file:
                file.write(text.replace(NAME, name).replace(CLASS, class_name))
    except OSError as error:
        raise NewGameError(f"cannot write {error.filename}: {error.strerror}; choose another --folder") from error
    return f"{files['.py']} and {files['.yaml']} are written.\n\n" + _next(name, class_name, folder)


def _check_name(name: str, class_name: str) -> None:
    """Raise NewGameError for what cannot be the name of a game, its module and its class."""
    if not re.fullmatch("[a-z][a-z0-9_]*", name):
        wanted = "small letters, digits and underscores, a letter first, as in my_game"
        raise NewGameError(f"a game cannot be named {name!r}: its name is its module's, too; use {wanted}")
    if iskeyword(name):
        raise NewGameError(f"a game cannot be named {name!r}, a word of Python's own; try {name}_game")
    if name in BUILT_IN:
        raise NewGameError(f"{name!r} is a built-in game; choose another name, as in my_{name}")
    if hasattr(builtins, class_name) or hasattr(joybridge.simulator.game, class_name):
        raise NewGameError(f"the class of {name!r} would be {class_name}, which is another thing; try my_{name}")


def _next(name: str, class_name: str, folder: Path) -> str:
    """Return the commands that come next, as typed in the folder that one is in."""
    joybridge, game = shlex.quote(_command(folder)), f"--game {name}:{class_name}"
    go = "" if folder.resolve() == Path.cwd() else f"  {shlex.join(['cd', str(folder)])}\n"
    return f"""Serve it:

{go}  {joybridge} serve {game}

and while that runs, in another terminal:

{go}  {joybridge} check 127.0.0.1:5005 --game {name}
  {joybridge} train {name}.yaml {game} --run runs/{name}
  {joybridge} evaluate runs/{name} {game}
  {joybridge} record runs/{name} {name}.mp4 {game}"""


def _command(folder: Path) -> str:
    """Return the shortest name of this installation's `joybridge` that a shell in `folder` finds."""
    script = str(Path(sys.executable).parent / "joybridge")
    if shutil.which("joybridge") == script:
        return "joybridge"
    return min(script, os.path.relpath(script, folder), key=len)
