"""Fences against accidents: what a program may not do while it is played. They do not stop one that means harm.

The program reads what it likes. It writes only below its own folder, which is its home and working directory, and has
no network, no further processes, and no standard input.
"""

import builtins
import os
import resource
import shutil
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NoReturn

import pygame

from joybridge.adapters.pygame_programs.inside.display import CANNOT_DRAW

WRITING = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND
CHANGES = {  # events whose first arguments are paths that are changed, and how many
    "os.mkdir": 1,
    "os.rename": 2,
    "os.remove": 1,
    "os.rmdir": 1,
    "os.link": 2,
    "os.symlink": 2,
    "os.truncate": 1,
    "os.chmod": 1,
    "os.chown": 1,
    "os.utime": 1,
    "sqlite3.connect": 1,
}
RELATIVE = {"os.remove", "os.rmdir"}  # whose second argument is the descriptor of a folder, or -1
PROCESSES = {
    "subprocess.Popen",
    "os.system",
    "os.exec",
    "os.fork",
    "os.forkpty",
    "os.posix_spawn",
    "os.spawn",
    "pty.spawn",
}
PROCESSES |= {"webbrowser.open", "os.kill", "os.startfile"}
NAMES = {"socket.getaddrinfo", "socket.gethostbyname", "socket.gethostbyaddr"}
PEERS = {"socket.connect", "socket.bind", "socket.sendto", "socket.sendmsg"}


def own_copy(path: str, folder: str, beside: str) -> None:
    """Replace links on the way to a path by what they lead to, so that it can be written without a change there.

    folder: in which this is done. beside: the folder to which the links lead; others are left as they are.
    """
    if not (beside and path.startswith(folder)):
        return
    place = Path(folder)
    for part in Path(path).relative_to(folder).parts:
        place /= part
        target = place.resolve() if place.is_symlink() else place
        if target == place or not target.is_relative_to(beside):
            continue
        if target.is_dir():
            place.unlink()
            place.mkdir()
            for each in target.iterdir():
                (place / each.name).symlink_to(each)
        elif target.is_file():
            place.unlink()
            shutil.copy(target, place)


class Fences:
    """The hook that looks at what the program does."""

    def __init__(self, folder: str) -> None:
        """folder: below which the program may write. Nothing is refused before `raise_up`."""
        self.folder = os.path.realpath(folder) + os.sep
        self.beside = ""  # the folder whose files and folders are linked in working directories; "" for none
        self.refused = ""  # what was refused last
        self.trusted = True  # while the surroundings of the program act

    def raise_up(self, megabytes: int) -> None:
        """Begin to refuse. megabytes: of memory that the process may have."""
        resource.setrlimit(resource.RLIMIT_DATA, (megabytes << 20, megabytes << 20))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        save = pygame.image.save

        def save_image(surface: Any, filename: Any, *arguments: Any) -> None:  # which raises no event by itself
            if isinstance(filename, str | bytes | os.PathLike):
                self._check_write(filename)
            save(surface, filename, *arguments)

        pygame.image.save = pygame.image.save_extended = save_image
        builtins.input = self._no_input
        sys.addaudithook(self._look)
        self.trusted = False

    @contextmanager
    def trusting(self) -> Iterator[None]:
        """Let everything pass meanwhile."""
        before, self.trusted = self.trusted, True
        try:
            yield
        finally:
            self.trusted = before

    def _look(self, event: str, arguments: tuple[Any, ...]) -> None:
        if self.trusted:
            return
        if event == "open":
            path, mode, flags = arguments
            if (isinstance(mode, str) and set(mode) & set("wax+")) or (isinstance(flags, int) and flags & WRITING):
                self._check_write(path)
        elif event == "import":
            if arguments[0] in CANNOT_DRAW:
                need = CANNOT_DRAW[arguments[0]]
                self._refuse(f"{arguments[0]} needs {need}, which a program here does not have", ImportError)
        elif event in CHANGES:
            paths = arguments[: CHANGES[event]]
            if event in RELATIVE and arguments[1] >= 0:
                paths = (f"/proc/self/fd/{arguments[1]}/{os.fsdecode(paths[0])}",)
            for path in paths:
                self._check_write(path)
        elif event in PROCESSES:
            self._refuse(f"the program may not start or end processes ({event})")
        elif event in NAMES or (event in PEERS and isinstance(arguments[1], tuple)):  # a path: a local socket
            self._refuse(f"the program may not use the network ({event})")

    def _check_write(self, path: Any) -> None:
        if isinstance(path, int):  # a descriptor, which was opened before
            return
        name = os.fsdecode(path)
        with self.trusting():
            own_copy(os.path.abspath(name), self.folder, self.beside)  # noqa: PTH100 (it keeps links)
            place = os.path.realpath(name)
        if name not in (os.devnull, ":memory:", "") and not place.startswith(self.folder):
            self._refuse(
                f"the program may write in its home, its working directory and beside itself only, not {place}"
            )

    def _refuse(self, text: str, kind: type[Exception] = PermissionError) -> NoReturn:
        self.refused = text
        raise kind(text)

    def _no_input(self, prompt: object = "") -> NoReturn:
        self._refuse("the program may not read standard input, to which nobody writes")
