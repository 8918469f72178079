"""Input tapes: regression tests of programs that are written with pygame, without any training.

`replay("tests/opening.tape")` in a test fails at the first frame that is not as it was.
"""

import shlex
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from joybridge.adapters.pygame_programs.first_play import random_acts
from joybridge.adapters.pygame_programs.rerun import opened
from joybridge.adapters.pygame_programs.tape import (
    Difference,
    TapeError,
    compare,
    pygame_version,
    read_tape,
    write_tape,
)
from joybridge.adapters.settings import AdapterError

__all__ = ["TapeError", "record", "replay"]


def record(program: str, tape: str | Path, *, seed: int = 0, decisions: int = 256, **options: str) -> int:
    """Write a tape of random play, and return how many frames it has. It ends with the episode.

    program: "PROGRAM KEY=VALUE … -- ARGUMENTS", as after --pygame. seed: of the program and of what is pressed.
    options: of the game. Raises TapeError, and AdapterError for a program that cannot be run.
    """
    with opened(program, options) as (rerun, _):
        return write_tape(Path(tape), rerun, seed, random_acts(rerun.form, seed, decisions))


def replay(tape: str | Path, program: str = "", pictures: str | Path | None = None) -> int:
    """Play a tape again, and return how many frames it has. Raises TapeError at the first frame that differs.

    program: another than that of the tape, for example in another folder; without settings behind it, it gets those of
    the tape. pictures: the folder for what was expected and what came, side by side, if a frame differs; default: that
    of the tape.
    """
    tape = Path(tape)
    read = read_tape(tape)
    try:
        with opened(_with_settings(program, read.note["program"]), read.note["options"]) as (rerun, _):
            return compare(read, rerun)
    except AdapterError as error:
        if program:
            raise
        raise TapeError(
            f"{read.note['program']}: {error}; that is how the tape names its program; --program, or program= in "
            "Python, says where it is now, with its settings, in quotes"
        ) from error
    except Difference as found:
        shown = Path(pictures or tape.parent) / f"{tape.stem}-frame-{found.frame}.png"
        expected = read.picture(found.decision)
        text = f"{found}: {_beside(expected, found.picture, shown)}; if the change is meant, record the tape again"
        if not found.decision:
            text += ". So early, it may be what the program has saved beside itself and shows, such as a high score"
        before, now = read.note.get("pygame", ""), pygame_version()
        drawn = f"; it was recorded with {before}, and this is {now}" if before and before != now else ""
        raise TapeError(f"{text}{drawn}") from None


def _with_settings(program: str, taped: str) -> str:
    """Return the program that is played, with the settings of the tape if it has none."""
    if not program:
        return taped
    words = shlex.split(program)
    return shlex.join([*words, *shlex.split(taped)[1:]]) if len(words) == 1 else program


def _beside(expected: Any, came: Any, path: Path) -> str:
    """Write two pictures and their difference beside each other, and return what is said. Raises TapeError."""
    pictures, alike = [expected, came], False
    if expected.shape == came.shape:
        differs = (expected != came).any(axis=2, keepdims=True)
        alike = not differs.any()
        pictures.append(np.where(differs, np.array([255, 0, 0], np.uint8), came // 4))
    height = max(map(len, pictures))
    parts = [np.pad(one, ((0, height - len(one)), (0, 4), (0, 0)), constant_values=255) for one in pictures]
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        Image.fromarray(np.concatenate(parts, axis=1)).save(path)
    except OSError as error:
        raise TapeError(f"cannot write {path}: {error.strerror or error}") from error
    said = f"{path} has the expected picture, then the one that came, then what differs, in red"
    small = "; these are small, of the end of the decision, and alike, so what differs is finer or is gone by then"
    return said + small * alike
