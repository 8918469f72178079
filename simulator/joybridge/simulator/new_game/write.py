"""Write a new game: a copy of the template, in which the names of game and class are the author's."""

import builtins
import os
import re
import shlex
import shutil
import sys
from collections.abc import Iterable, Mapping
from importlib.machinery import PathFinder
from importlib.util import find_spec
from keyword import iskeyword
from pathlib import Path

import joybridge.simulator
from joybridge.contract.errors import JoybridgeError
from joybridge.games import BUILT_IN

TEMPLATE = Path(__file__).parent / "template"
NAME, CLASS = "my_game", "MyGame"  # in the template, where they are replaced
SUFFIXES = (".py", ".yaml")


class NewGameError(JoybridgeError):
    """A new game cannot be written. The message says why and what to do instead."""


def write_game(name: str, folder: Path) -> str:
    """Write NAME.py and NAME.yaml into a folder, which is created if necessary; return the commands to type next.

    Existing files are never overwritten. Raises NewGameError.
    """
    class_name = "".join(part.capitalize() for part in name.split("_"))
    files = {suffix: folder / f"{name}{suffix}" for suffix in SUFFIXES}
    _check_name(name, class_name)
    check_new(files.values())
    if name in sys.modules or find_spec(name) or PathFinder.find_spec(name, [str(folder)]):
        raise NewGameError(f"there is a module {name!r} already, which {name}.py would hide; try {name}_game")
    texts = {suffix: (TEMPLATE / f"{NAME}{suffix}").read_text(encoding="utf-8") for suffix in SUFFIXES}
    write_new({path: texts[suffix].replace(NAME, name).replace(CLASS, class_name) for suffix, path in files.items()})
    return f"Created {files['.py']} (the game) and {files['.yaml']} (its training).\n\n" + _next(
        name, class_name, folder
    )


def check_new(paths: Iterable[Path]) -> None:
    """Raise NewGameError if one of these files exists."""
    for path in paths:
        if path.exists():
            raise NewGameError(f"{path} exists and is not overwritten; choose another name or --folder")


def write_new(texts: Mapping[Path, str]) -> None:
    """Write new files, all or none, and the folders that they are in. Existing ones are never overwritten.

    Raises NewGameError.
    """
    created: list[Path] = []
    try:
        for path, text in texts.items():
            path.parent.mkdir(parents=True, exist_ok=True)
            with path.open("x", encoding="utf-8") as file:
                created.append(path)
                file.write(text)
    except OSError as error:
        for path in created:
            path.unlink(missing_ok=True)
        raise NewGameError(f"cannot write {error.filename}: {error.strerror}; choose another --folder") from error


def _check_name(name: str, class_name: str) -> None:
    """Raise NewGameError if the name cannot be used for a game, its module and its class."""
    if not re.fullmatch("[a-z][a-z0-9_]*", name):
        wanted = "lower-case letters, digits and underscores, starting with a letter, for example my_game"
        raise NewGameError(f"a game cannot be named {name!r}: its module has the same name; use {wanted}")
    if iskeyword(name):
        raise NewGameError(f"a game cannot be named {name!r}, a keyword of Python; try {name}_game")
    if name in BUILT_IN:
        raise NewGameError(f"{name!r} is a built-in game; choose another name, for example my_{name}")
    if hasattr(builtins, class_name) or hasattr(joybridge.simulator, class_name):
        raise NewGameError(f"the class of {name!r} would be {class_name}, a name that is taken; try my_{name}")


def _next(name: str, class_name: str, folder: Path) -> str:
    """Return the commands to type next in the current folder."""
    joybridge, game = shlex.quote(command(folder)), f"{name}:{class_name}"
    go = "" if folder.resolve() == Path.cwd() else f"  {shlex.join(['cd', str(folder)])}\n"
    return f"""Serve the game:

{go}  {joybridge} serve --game {game}

Then, in another terminal, check it against the contract, look at random play, train it, evaluate the policy and record
a video:

{go}  {joybridge} check 127.0.0.1:5005 --game {name}
  {joybridge} look {game} {name}.png
  {joybridge} train {name}.yaml --run runs/{name}
  {joybridge} evaluate runs/{name}
  {joybridge} record runs/{name} {name}.mp4"""


def command(folder: Path) -> str:
    """Return the shortest path of this installation's `joybridge` script that works in `folder`."""
    script = str(Path(sys.executable).parent / "joybridge")
    if shutil.which("joybridge") == script:
        return "joybridge"
    return min(script, os.path.relpath(script, folder), key=len)
