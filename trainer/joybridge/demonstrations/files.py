"""The files that a run learns from: which there are, which it began with, and what they hold. Needs no torch."""

import hashlib
from pathlib import Path

from joybridge.client.demonstration_log import SUFFIX
from joybridge.client.recording import MAX_FILE_BYTES, RecordingError
from joybridge.config.errors import ConfigError
from joybridge.config.files import write_atomically
from joybridge.contract.files import read_file
from joybridge.demonstrations.formats import foreign_formats, formats_of
from joybridge.demonstrations.recorded import Demonstration, load_recorded
from joybridge.v1 import bridge_pb2 as pb

SUMS = "demonstrations.sha256"  # in the folder of a run: the files that it learns from, as `sha256sum` writes them
MAX_SUMS_BYTES = 2**24  # bytes of it


def find_demonstrations(folder: Path) -> list[Path]:
    """Return the files of a folder, and of the datasets in it, by name. Raises ConfigError if there are none."""
    patterns = dict.fromkeys([f"*{SUFFIX}", *(pattern for one in foreign_formats() for pattern in one.patterns)])
    files = [file for pattern in patterns for file in sorted(folder.glob(pattern))]
    if not files:
        raise ConfigError(
            f"demonstrations: {folder} holds no file *{SUFFIX}, nor a dataset of Minari; record some with "
            f"`joybridge play GAME --demos {folder}` or `joybridge evaluate RUN --demos {folder}`"
        )
    return files


def chosen_demonstrations(folder: Path, run: Path, *, resumed: bool) -> tuple[list[Path], list[str]]:
    """Return the files that a run learns from, and remarks. A new run takes all, and notes their checksums.

    A resumed run takes the same ones. Raises ConfigError if one is missing or has changed, and StorageError.
    """
    note = run / SUMS
    files = find_demonstrations(folder)
    try:
        if not resumed:
            lines = [f"{_sum(file)}  {file.relative_to(folder).as_posix()}\n" for file in files]
            run.mkdir(parents=True, exist_ok=True)
            write_atomically(note, "".join(lines).encode())
            return files, []
        pairs = [line.split("  ", 1) for line in read_file(note, MAX_SUMS_BYTES).decode().splitlines()]
        known = [(wanted, folder / name) for wanted, name in pairs]
        for wanted, file in known:
            if not file.exists() or _sum(file) != wanted:
                raise ConfigError(f"demonstrations: {file} is not as it was when the run began; put it back as it was")
    except (OSError, ValueError) as error:
        if isinstance(error, ConfigError):
            raise
        raise ConfigError(f"demonstrations: {note} cannot be read ({error}); train a new run") from error
    own = [file for _, file in known]
    new = [str(file.relative_to(folder)) for file in files if file not in own]
    return own, [f"{', '.join(new)}: not learned from, because the run began without"] if new else []


def load_demonstration(path: Path, spec: pb.GameSpec) -> Demonstration:
    """Return what a file holds. Raises RecordingError unless it fits a game with this spec, and ConfigError."""
    for one in formats_of(path):
        return one.load(path, spec)
    return load_recorded(path, spec)


def foreign_kind(path: Path) -> str:
    """Return what a file or folder is in words if it is in the format of others, "" otherwise."""
    return next((one.kind for one in formats_of(path)), "")


def _sum(file: Path) -> str:
    """Return the checksum of a demonstration. Raises RecordingError."""
    try:
        return hashlib.sha256(read_file(file, MAX_FILE_BYTES)).hexdigest()
    except (OSError, ValueError) as error:
        raise RecordingError(f"{file} cannot be read ({error}); move it elsewhere") from error
