"""What of a mouse and a keyboard a program reads, and what it calls an end, from its sources.

Keys that come from configuration files or numbers are not found; the setting `keys` names them.
"""

import ast
import re
import sys
from collections.abc import Iterator
from contextlib import suppress
from hashlib import blake2b
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pygame

from joybridge.adapters.pygame_programs.wire import ENDING

POINTER = {"MOUSEMOTION", "MOUSEBUTTONDOWN", "MOUSEBUTTONUP", "FINGERDOWN"}
JOYSTICK = {"Joystick", "JOYAXISMOTION", "JOYBUTTONDOWN"}
BUTTON_NAMES = {"BUTTON_LEFT": 1, "BUTTON_MIDDLE": 2, "BUTTON_RIGHT": 3, "BUTTON_WHEELUP": 4, "BUTTON_WHEELDOWN": 5}
END_TEXT = re.compile(r"game over|you (?:win|won|lose|lost|died|are dead)|\bwins\b", re.IGNORECASE)
MAX_FILES = 500  # that are read
MAX_BYTES = 2_000_000  # of each


class Controls(NamedTuple):
    """What a program seems to read."""

    keys: list[str]  # as in pygame.K_…, without those that end it
    pointer: bool
    buttons: list[str]  # of the mouse
    wheel: bool
    joystick: bool


def scan(root: Path) -> Controls:
    """Return what the modules of a program read. root: its file, or the folder of its package."""
    names: set[str] = set()
    numbers: set[int] = set()  # of buttons with which an event is compared, from 1 on
    for node in _nodes(root):
        names |= _names(node)
        numbers |= _buttons(node)
    keys = {name[2:] for name in names if name.startswith("K_") and isinstance(getattr(pygame, name, None), int)}
    pointer = bool(names & POINTER) or ("mouse" in names and bool(names & {"get_pos", "get_rel"}))
    numbers |= {number for name, number in BUTTON_NAMES.items() if name in names}
    buttons = ["left", *(["middle"] if 2 in numbers else []), *(["right"] if 3 in numbers else [])]
    wheel = "MOUSEWHEEL" in names or bool(numbers & {4, 5})
    joystick = bool(names & JOYSTICK)
    return Controls(sorted(keys - ENDING), pointer, buttons if pointer else [], pointer and wheel, joystick)


def end_texts(root: Path) -> list[str]:
    """Return what strings of the modules call an end, as in "Game over". root: see `scan`."""
    found, said = dict[str, None](), set[ast.AST]()  # the second: what stands alone, as docstrings do
    for node in _nodes(root):
        if isinstance(node, ast.Expr):
            said.add(node.value)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and node not in said:
            found |= dict.fromkeys(END_TEXT.findall(node.value))
    return list(found)


def hash_of_sources(root: Path) -> str:
    """Return a hash of the modules of a program, and of the versions of what runs them. root: see `scan`."""
    digest = blake2b(f"{sys.version} {pygame.version.ver} {pygame.version.SDL} {np.__version__}".encode())
    for path in _files(root):
        with suppress(OSError):
            digest.update(path.read_bytes())
    return digest.hexdigest()


def needs_joystick(controls: Controls, wanted: bool | None) -> bool:
    """Return whether a joystick is plugged in: as it is wanted, or if the program seems to read nothing else."""
    return controls.joystick and not (controls.keys or controls.pointer) if wanted is None else wanted


def _names(node: ast.AST) -> set[str]:
    """Return the names in a node; one in quotes may be meant for getattr."""
    if isinstance(node, ast.Attribute):
        return {node.attr}
    if isinstance(node, ast.Name):
        return {node.id}
    if isinstance(node, ast.ImportFrom):
        return {alias.name for alias in node.names}
    return {node.value} if isinstance(node, ast.Constant) and isinstance(node.value, str) else set()


def _buttons(node: ast.AST) -> set[int]:
    """Return the numbers of buttons in `event.button == 3`, `button in (4, 5)` or `get_pressed()[2]`."""
    if isinstance(node, ast.Compare):
        parts = [node.left, *node.comparators]
        if any("button" in (getattr(part, "attr", ""), getattr(part, "id", "")) for part in parts):
            return {number for part in parts for one in ast.walk(part) for number in _numbers(one)}
    if isinstance(node, ast.Subscript) and isinstance(node.value, ast.Call):
        called = node.value.func
        mouse = isinstance(called, ast.Attribute) and ast.unparse(called).endswith("mouse.get_pressed")
        return {number + 1 for number in _numbers(node.slice)} if mouse else set()
    return set()


def _numbers(node: ast.AST) -> set[int]:
    return {node.value} if isinstance(node, ast.Constant) and type(node.value) is int else set()


def _nodes(root: Path) -> Iterator[ast.AST]:
    """Yield all parts of the sources of a program."""
    for path in _files(root):
        try:
            yield from ast.walk(ast.parse(path.read_bytes()[:MAX_BYTES]))
        except (OSError, SyntaxError, ValueError, RecursionError):
            continue


def _files(root: Path) -> list[Path]:
    """Return the files of a package; for a single file, those in its folder that are imported as well.

    Those of Joybridge, which may lie below the same folder, are imported here, too, and are not the program's.
    """
    if root.is_dir():
        return sorted(root.rglob("*.py"))[:MAX_FILES]
    loaded = {Path(file) for module in list(sys.modules.values()) if (file := getattr(module, "__file__", None))}
    ours = {Path(folder) for folder in sys.modules["joybridge"].__path__}
    own = {
        path
        for path in loaded
        if root.parent in path.parents and "site-packages" not in path.parts and not ours & set(path.parents)
    }
    return sorted({root, *(path for path in own if path.suffix == ".py")})[:MAX_FILES]
