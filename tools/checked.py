"""What checks of the whole product share: how one fails, how one is left out, and environments of their own."""

import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path

MISSING = 77  # exit status: nothing was checked, because something is not there that the check needs
INSTALL_SECONDS = 1800.0


class Failed(Exception):
    """Something that the product should do and does not; the text says what came."""


def make_environment(folder: Path, python: str, *packages: Sequence[str]) -> str:
    """Make an environment of Python and install packages there; return what is in the way, "" if nothing is.

    packages: the arguments of pip, for each of its calls. The folder is deleted before, and after a failure.
    """
    shutil.rmtree(folder, ignore_errors=True)
    pip = [str(folder / "bin/python"), "-m", "pip", "install", "--quiet", "--no-compile", "--disable-pip-version-check"]
    for command in ([python, "-m", "venv", str(folder)], *([*pip, *each] for each in packages)):
        try:
            subprocess.run(command, check=True, capture_output=True, text=True, timeout=INSTALL_SECONDS)
        except (subprocess.SubprocessError, OSError) as error:
            shutil.rmtree(folder, ignore_errors=True)
            said = str(getattr(error, "stderr", "") or error).strip().splitlines()
            return said[-1] if said else str(error)
    return ""
