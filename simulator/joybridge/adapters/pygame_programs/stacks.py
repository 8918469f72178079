"""Where the processes of a program stood when a frame took too long or they crashed, from what faulthandler wrote."""

import re
import sysconfig
from pathlib import Path

from joybridge.adapters.pygame_programs.wire import STACKS

OURS = Path(__file__).parent
PYTHON = [sysconfig.get_path(name) for name in ("stdlib", "purelib", "platlib")]
LINE = re.compile(r'  File "(?P<file>[^"<]+)", line (?P<line>\d+)')


class Stacks:
    """The file to which all processes of a program append their last stack."""

    def __init__(self, folder: Path) -> None:
        """folder: of the program."""
        self._path, self._read = folder / STACKS, 0

    def take(self) -> str:
        """Return what has been written since the last call; "" for nothing."""
        try:
            data = self._path.read_bytes()
        except OSError:
            return ""
        new, self._read = data[self._read :], len(data)
        return new.decode(errors="replace")


def place_of(stack: str) -> str:
    """Return ", at line N of FILE": the innermost line that is not of Python or its packages; "" if there is none."""
    lines = [(found["file"], found["line"]) for found in LINE.finditer(stack)]
    outside = [line for line in lines if not Path(line[0]).is_relative_to(OURS)]
    own = [line for line in outside if not any(Path(line[0]).is_relative_to(folder) for folder in PYTHON)]
    return next((f", at line {number} of {file}" for file, number in [*own, *outside]), "")
