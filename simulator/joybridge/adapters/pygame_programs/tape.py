"""The file of an input tape: what was pressed in an episode of a program, and a hash of each frame that came of it.

It is a ZIP archive:

    tape.json              the program and its settings, options, seed, and the names of axes and branches
    acts.npy               what was pressed: uint8 [decisions, bytes of an act], float32 axes before int32 choices
    hashes.npy, ends.npy   of all frames: uint64 [frames]; how many there were after each decision: int32 [decisions]
    pictures/0, 1, …       the display after each decision, made small: RGB, each combined with the one before by XOR
"""

import io
import json
import os
import zipfile
import zlib
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from importlib.metadata import PackageNotFoundError, version
from itertools import count
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from joybridge.adapters.pygame_programs.form import Form, Look, make_form
from joybridge.adapters.pygame_programs.players import Players
from joybridge.adapters.pygame_programs.processes import ProgramProcesses
from joybridge.adapters.pygame_programs.settings import PygameSettings
from joybridge.contract.errors import JoybridgeError
from joybridge.contract.tensors import Array
from joybridge.progress import Progress
from joybridge.simulator.batched_game import GameError

FORMAT = 2
_NUMBERS = count()  # of the writers of this process: two sessions may write the tape of the same seed
MAX_PICTURE_PIXELS = 480  # of width and height: a tape stays small enough to be kept beside a program


class TapeError(JoybridgeError):
    """A program does not play as on a tape, or a file is no tape."""


class TapeWriter:
    """Writes the tape of an episode while it is played, beside its file, which is replaced when the tape is whole."""

    def __init__(self, path: Path, note: Mapping[str, Any]) -> None:
        """note: from `note_of`."""
        self.path, self._note = path, note
        self._part = path.with_name(f"{path.name}.{os.getpid()}-{next(_NUMBERS)}.part")
        self._archive: zipfile.ZipFile | None = None
        self._acts: list[bytes] = []
        self._ends: list[int] = []
        self._hashes: list[int] = []
        self._before: Array = np.zeros((), np.uint8)

    def add(self, act: bytes, hashes: Array, picture: Array) -> None:
        """Append a decision: the hashes of its frames, and the display after it. Raises TapeError."""
        self._hashes += hashes.tolist()
        with self._storing():
            if self._archive is None:
                self.path.parent.mkdir(parents=True, exist_ok=True)
                self._archive = zipfile.ZipFile(self._part, "w", zipfile.ZIP_DEFLATED)
            _save(self._archive, f"pictures/{len(self._ends)}", picture ^ self._before)
        self._acts.append(act)
        self._ends.append(len(self._hashes))
        self._before = picture

    def close(self) -> int:
        """End the tape, and return how many frames it has. Raises TapeError."""
        if self._archive is not None:
            with self._storing(), self._archive as archive:
                archive.writestr("tape.json", json.dumps(self._note, indent=2))
                _save(archive, "acts.npy", np.frombuffer(b"".join(self._acts), np.uint8).reshape(len(self._acts), -1))
                _save(archive, "hashes.npy", np.array(self._hashes, np.uint64))
                _save(archive, "ends.npy", np.array(self._ends, np.int32))
            with self._storing():
                self._part.replace(self.path)
        return len(self._hashes)

    def discard(self) -> None:
        """Leave the file as it was before."""
        if self._archive is not None:
            with suppress(OSError):
                self._archive.close()
            self._part.unlink(missing_ok=True)

    @contextmanager
    def _storing(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise TapeError(f"cannot write {error.filename or self.path}: {error.strerror or error}") from error


def note_of(form: Form, settings: PygameSettings, options: Mapping[str, str], seed: int) -> dict[str, Any]:
    """Return what a tape of an episode says about it. options: all of them."""
    names = [axis.name for axis in form.axes()] + [branch.name for branch in form.branches()]
    return {
        "format": FORMAT,
        "program": settings.text,
        "options": dict(options),
        "seed": seed,
        "device": names,
        "pygame": pygame_version(),
    }


def pygame_version() -> str:
    """Return which pygame is installed, as in "pygame 2.6.1"; "" for none."""
    for package in ("pygame-ce", "pygame"):
        with suppress(PackageNotFoundError):
            return f"{package} {version(package)}"
    return ""


class Rerun:
    """One arena of a program, in which episodes are played with hashes of all frames."""

    def __init__(self, processes: ProgramProcesses, look: Look, options: Mapping[str, str]) -> None:
        """options: all of them."""
        self.form, self._options, self._settings = make_form(look, options), options, processes.settings
        told = self.form.inside(self._settings.number("seconds"), hashes=True)
        self._players = Players(processes, self.form, told, 1)

    def note(self, seed: int) -> dict[str, Any]:
        """Return what a tape of an episode says about it."""
        return note_of(self.form, self._settings, self._options, seed)

    def play(self, seed: int, acts: Iterable[bytes]) -> Iterator[tuple[bytes, Array]]:
        """Play an episode, and yield each act with the hashes of its frames. Raises GameError."""
        try:
            self._players.begin([0], [seed])
            for act in acts:
                for played in self._players.play(0, [act]):
                    yield act, played.hashes
                    if played.over:
                        return
        finally:
            self._players.end([0])

    def draw(self) -> Array:
        """Return the display, made small, uint8 [height, width, 3]."""
        return self._players.draw(0, *self.form.look.picture(MAX_PICTURE_PIXELS))


class Tape(NamedTuple):
    """What a tape says, but for its pictures."""

    path: Path
    note: dict[str, Any]
    acts: Array  # uint8 [decisions, bytes]
    hashes: Array  # uint64 [frames]
    ends: Array  # int32 [decisions]

    def picture(self, decision: int) -> Array:
        """Return the display after a decision, uint8 [height, width, 3]."""
        with zipfile.ZipFile(self.path) as archive:
            pictures = [_load(archive, f"pictures/{number}") for number in range(decision + 1)]
        return np.asarray(np.bitwise_xor.reduce(pictures))


def write_tape(path: Path, rerun: Rerun, seed: int, acts: Iterable[bytes]) -> int:
    """Play an episode, write its tape, and return how many frames it has. Raises TapeError.

    A file that is there is replaced by a whole tape, and by nothing else.
    """
    writer = TapeWriter(path, rerun.note(seed))
    progress, decision = Progress(), 0
    try:
        for decision, (act, hashes) in enumerate(rerun.play(seed, acts), 1):
            writer.add(act, hashes, rerun.draw())
            progress.report(f"{decision:,} decisions are on the tape")
        return writer.close()
    except GameError as error:
        kept = "holds the tape that it held before" if path.exists() else "is not written"
        raise TapeError(f"{path} {kept}: {_after(decision)}{error}") from error
    finally:
        writer.discard()


def _after(decisions: int) -> str:
    return f"after {decisions:,} decisions " if decisions else ""


def read_tape(path: Path) -> Tape:
    """Return what a tape says. Raises TapeError."""
    try:
        with zipfile.ZipFile(path) as archive:
            note = json.loads(archive.read("tape.json"))
            if note["format"] != FORMAT:
                raise ValueError(f"its format is {note['format']}, expected {FORMAT}")
            tape = Tape(path, note, *(_load(archive, f"{name}.npy") for name in ("acts", "hashes", "ends")))
        _check(tape)
        return tape
    except OSError as error:
        raise TapeError(f"cannot read {path}: {error.strerror}") from error
    except (zipfile.BadZipFile, zlib.error, KeyError, ValueError, TypeError) as error:
        raise TapeError(f"{path} is not a tape ({error}); `joybridge tape record` makes one") from error


def _check(tape: Tape) -> None:
    """Raise ValueError, KeyError or TypeError unless the parts of a tape belong together."""
    kinds = {"program": str, "options": dict, "seed": int, "device": list, "pygame": str}
    if wrong := [key for key, kind in kinds.items() if not isinstance(tape.note[key], kind)]:
        raise ValueError(f"its {wrong[0]} is {tape.note[wrong[0]]!r}")
    ends = tape.ends
    if len(tape.acts) != len(ends) or not len(ends) or ends[-1] != len(tape.hashes) or (np.diff(ends) < 0).any():
        raise ValueError(f"{len(tape.acts)} decisions and {len(tape.hashes)} frames do not belong together")


def compare(tape: Tape, rerun: Rerun) -> int:
    """Play a tape again, and return how many frames it has. Raises Difference and TapeError."""
    note = rerun.note(tape.note["seed"])
    if note["device"] != tape.note["device"]:
        raise TapeError(
            f"the program is played with {', '.join(note['device'])}, the tape with {', '.join(tape.note['device'])}; "
            "name the former keys with keys=, buttons=, mouse= and wheel="
        )
    begin, progress = 0, Progress()
    try:
        for decision, (_, hashes) in enumerate(rerun.play(tape.note["seed"], map(bytes, tape.acts))):
            expected = tape.hashes[begin : tape.ends[decision]]
            same = min(len(hashes), len(expected))
            wrong = np.flatnonzero(hashes[:same] != expected[:same])
            if len(wrong):
                raise Difference(begin + int(wrong[0]), decision, rerun.draw())
            if len(hashes) != len(expected):
                raise TapeError(f"frame {begin + same}: the episode ends earlier or later than on the tape")
            begin += len(expected)
            progress.report(f"{begin:,} of {len(tape.hashes):,} frames are the same")
    except GameError as error:
        raise TapeError(f"after frame {begin}: {error}") from error
    if begin != len(tape.hashes):
        raise TapeError(f"after frame {begin}: the episode is over, on the tape it goes on")
    return begin


class Difference(TapeError):
    """A frame is not as on the tape."""

    def __init__(self, frame: int, decision: int, picture: Array) -> None:
        """picture: the display after the decision, uint8 [height, width, 3]."""
        super().__init__(f"frame {frame} is not as on the tape")
        self.frame, self.decision, self.picture = frame, decision, picture


def _save(archive: zipfile.ZipFile, name: str, array: Array) -> None:
    data = io.BytesIO()
    np.save(data, array)
    archive.writestr(name, data.getvalue())


def _load(archive: zipfile.ZipFile, name: str) -> Array:
    return np.asarray(np.load(io.BytesIO(archive.read(name)), allow_pickle=False))
