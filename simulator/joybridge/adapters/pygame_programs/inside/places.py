"""Where a program writes that names files by its own place, as in `Path(__file__).parent / "scores.json"`.

What lies beside a program is in a folder of its own as well: as copies, and as links, which become copies when they are
written (`fences.own_copy`). Paths to the former lead to the latter.
"""

import builtins
import io
import os
import sqlite3
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pygame

from joybridge.adapters.pygame_programs.inside.fences import Fences
from joybridge.adapters.pygame_programs.inside.stem import MAX_BESIDE, Folders

OF_A_PATH = (
    "access", "chmod", "getxattr", "listdir", "listxattr", "mkdir", "open", "remove", "removexattr", "rmdir",
    "setxattr", "stat", "truncate", "unlink", "utime",
)  # fmt: skip


class Places:
    """Leads paths below one folder to another one."""

    def __init__(self, original: Path, name: str, folders: Folders, fences: Fences) -> None:
        """original: the folder of the program. name: of the other one, in the own folder of each process."""
        self._originals = {str(original), str(original.resolve())}
        self._name, self._folders, self._fences = name, folders, fences
        self._whole = (folders.own / name).is_symlink() or len(list(original.iterdir())) <= MAX_BESIDE

    def lead(self, path: Any) -> Any:
        """Return the path in the own folder; as it is, if it leads elsewhere, or to what is not in the own folder."""
        if self._fences.trusted or not isinstance(path, str | os.PathLike):
            return path
        place = os.path.normpath(os.fsdecode(path))
        for original in self._originals:
            if place == original or place.startswith(original + os.sep):
                own = f"{self._folders.own / self._name}{place[len(original) :]}"
                return own if self._whole or os.path.lexists(own) or not os.path.lexists(place) else path
        return path

    def take(self) -> None:
        """Take the place of the functions that take paths.

        Not of lstat, readlink and scandir: what they return leads to the original, and what is opened there, here.
        """
        for name in (name for name in OF_A_PATH if hasattr(os, name)):
            setattr(os, name, self._leading(getattr(os, name), "path"))
        for name in ("link", "rename", "replace", "symlink"):
            setattr(os, name, self._leading(getattr(os, name), "src", "dst"))
        builtins.open = io.open = self._leading(io.open, "file")
        sqlite3.connect = sqlite3.dbapi2.connect = self._leading(sqlite3.connect, "database")
        pygame.image.load = self._leading(pygame.image.load, "file")
        save = pygame.image.save

        def save_image(surface: Any, filename: Any, *arguments: Any) -> None:
            save(surface, self.lead(filename), *arguments)

        pygame.image.save = pygame.image.save_extended = save_image

    def _leading(self, real: Callable[..., Any], *names: str) -> Callable[..., Any]:
        """Return a function that leads its first arguments. names: of these, if they are given by name."""

        def lead(*arguments: Any, **options: Any) -> Any:
            led = [self.lead(path) for path in arguments[: len(names)]]
            options |= {name: self.lead(options[name]) for name in names if name in options}
            return real(*led, *arguments[len(names) :], **options)

        return lead
