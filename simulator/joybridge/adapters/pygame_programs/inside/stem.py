"""A stem: the process stands still at a frame, and forks a player whenever the server asks for one."""

import gc
import json
import os
import random
import shutil
from pathlib import Path
from typing import Any, NoReturn

from joybridge.adapters.pygame_programs.inside.fences import Fences
from joybridge.adapters.pygame_programs.wire import FORK, OWN_FOLDER_DESCRIPTOR, knock
from joybridge.simulator.workers.link import Link

MAX_BESIDE = 2000  # files and folders that a working directory begins with,
MAX_COPIES = 200  # and of how many small files it has copies
MAX_COPY_BYTES = 100_000
REMOVALS = 100  # tries to remove a folder in which others remove theirs


class Folders:
    """The folder of this process, in which its home and its working directory are."""

    def __init__(self, base: Path) -> None:
        """base: the folder of the program, in which each process has its own."""
        self.base, self.own = base, base / "0"

    def enter(self, own: Path) -> None:
        """Use an own folder from now on; the working directory moves along."""
        place = Path.cwd() if self.own.exists() else self.own
        handle = os.open(own, os.O_RDONLY)
        os.dup2(handle, OWN_FOLDER_DESCRIPTOR)  # by which the program knows its home
        os.close(handle)
        if place.is_relative_to(self.own):
            os.chdir(own / place.relative_to(self.own))
        self.own = own

    def branch(self, number: int) -> None:
        """Enter a copy of the present folder."""
        own = self.base / str(number)
        shutil.copytree(self.own, own, symlinks=True)
        self.enter(own)


def copy_beside(source: Path, work: Path) -> None:
    """Let a working directory have what a folder has: copies of small files, which may be changed, and links."""
    for number, path in enumerate(sorted(source.iterdir())[:MAX_BESIDE]):
        if (
            number < MAX_COPIES
            and path.is_file()
            and path.stat().st_size <= MAX_COPY_BYTES
            and os.access(path, os.R_OK)
        ):
            shutil.copy(path, work / path.name)
        else:
            (work / path.name).symlink_to(path)


def fork(folders: Folders, fences: Fences, number: int) -> Link | None:
    """Fork this process. Returns the link of the new process there, and None here."""
    state = random.getstate()
    with fences.trusting():
        if os.fork():
            return None
        random.setstate(state)  # Python seeds it again in a fork
        folders.branch(number)
        return knock(str(folders.base), number)


def serve(link: Link, folders: Folders, fences: Fences) -> tuple[Link, dict[str, Any]]:
    """Fork whenever the server asks. Returns in the new process: its own link, and what it was told.

    This process ends with the link.
    """
    gc.collect()
    gc.freeze()  # else the first collection of every fork copies all memory
    while True:
        try:
            kind, message = link.receive()
        except (EOFError, OSError):
            leave(folders, fences)
        assert kind == FORK, kind
        told = json.loads(message)
        own = fork(folders, fences, told["number"])
        if own is not None:
            link.close()
            return own, told


def leave(folders: Folders, fences: Fences) -> NoReturn:
    """End this process without a word. What is left in its folder goes with it."""
    with fences.trusting():
        if folders.own != folders.base / "0":
            shutil.rmtree(folders.own, ignore_errors=True)
        for _ in range(REMOVALS):  # players remove their own folders at the same time
            if folders.own == folders.base / "0" and folders.base.exists():
                shutil.rmtree(folders.base, ignore_errors=True)
    _exit(0)


_exit = os._exit  # which programs are not given
