"""Checkpoints: safetensors for arrays, JSON for the rest, and the SHA-256 of both, so that a damaged one is noticed.

A run's `checkpoints/` holds one folder per checkpoint, named by its timesteps in twelve digits; the newest ones are
kept. `SHA256SUMS` is in the format of `sha256sum --check`. Anything else in `checkpoints/` is neither read nor deleted.
"""

import hashlib
import logging
import shutil
from contextlib import suppress
from functools import cache
from pathlib import Path

from pydantic import BaseModel, ConfigDict, Field, ValidationError
from safetensors import SafetensorError
from safetensors.numpy import load, save

from joybridge.config.errors import CheckpointError, StorageError
from joybridge.config.files import storing, sync_folder, write_synced
from joybridge.config.json_files import reason_of
from joybridge.contract.files import read_file
from joybridge.contract.tensors import Array
from joybridge.run.origin import Origin

log = logging.getLogger("joybridge.trainer")

FORMAT = 4
BEST = "best"  # name of the folder of the best checkpoint
NO_CHECKPOINT = (
    "holds no checkpoint; train it first, or, while it trains, wait for its first (checkpoint_seconds), or name "
    "another run"
)
ARRAYS, MANIFEST, SUMS = "arrays.safetensors", "manifest.json", "SHA256SUMS"
MAX_ARRAYS_BYTES = 2**32  # bytes
MAX_TEXT_BYTES = 2**20  # bytes of the other two files


class Manifest(BaseModel):
    """What a checkpoint holds besides arrays."""

    model_config = ConfigDict(strict=True, frozen=True, extra="forbid")

    format: int = FORMAT
    timesteps: int = Field(ge=0, lt=10**12)
    snapshots: list[list[str]] | None = None  # parts of each session's snapshot; None: the game has none
    score: float | None = None  # what the metric `best_metric` was, if a row of metrics was just written
    origin: Origin | None = None  # with what it was trained; None: it was not noted
    arrays_bytes: int = Field(0, ge=0, le=MAX_ARRAYS_BYTES)  # size of the arrays' file


class _Format(BaseModel):
    """The part of a manifest that every version of Joybridge has."""

    format: int


def save_checkpoint(
    run: Path, arrays: dict[str, Array], manifest: Manifest, keep: int = 2, *, best: bool = False
) -> Path:
    """Write a checkpoint atomically, delete those before the newest `keep`, and return its folder.

    best: write it as the best one instead, in place of the former best. Raises StorageError; then nothing of the new
    checkpoint is left, and the older ones are still there.
    """
    folder = run / "checkpoints"
    target = folder / (BEST if best else f"{manifest.timesteps:012d}")
    if not best and target.exists() and _is_whole(target):  # the run has not moved on since its last checkpoint
        return target
    temporary = folder / ".new"
    with storing(folder):
        shutil.rmtree(temporary, ignore_errors=True)  # of a run that was killed
        try:
            temporary.mkdir(parents=True)
            data = save(arrays)
            text = manifest.model_copy(update={"arrays_bytes": len(data)}).model_dump_json(indent=1).encode()
            for name, content, most in ((ARRAYS, data, MAX_ARRAYS_BYTES), (MANIFEST, text, MAX_TEXT_BYTES)):
                if len(content) > most:
                    raise StorageError(f"{target / name} has {len(content):,} bytes, expected at most {most:,}")
            write_synced(temporary / ARRAYS, data)
            write_synced(temporary / MANIFEST, text)
            write_synced(temporary / SUMS, _sums(data, text))
            sync_folder(temporary)
            if target.exists():
                _remove(target)  # a damaged one, or the former best
            temporary.rename(target)
        except BaseException:
            shutil.rmtree(temporary, ignore_errors=True)
            raise
        sync_folder(folder)
    if best:
        return target
    older = [path for path in reversed(checkpoints(run)) if path.name < target.name]
    for old in older[keep - 1 :]:
        _delete(old)
    return target


def load_checkpoint(run: Path, which: str = "") -> tuple[dict[str, Array], Manifest]:
    """Return arrays and manifest of a checkpoint: "best", its timesteps, or "" for the newest.

    The newest is the newest that is whole; those that are not are logged. Raises CheckpointError.
    """
    folders = checkpoints(run)
    if which:
        names = {str(int(folder.name)): folder for folder in folders}
        if (best := run / "checkpoints" / BEST).is_dir():
            names[BEST] = best
        if which not in names:
            raise CheckpointError(f"{run} has no checkpoint {which!r}; it has {', '.join(names) or 'none'}")
        return read_checkpoint(names[which])
    if not folders:
        raise CheckpointError(f"{run} {NO_CHECKPOINT}")
    errors = []
    for folder in reversed(folders):
        try:
            arrays, manifest = read_checkpoint(folder)
        except CheckpointError as error:
            errors.append(error)
            continue
        for problem in errors:
            _warn(f"{problem}; using the checkpoint before it, of {manifest.timesteps:,} timesteps")
        return arrays, manifest
    others = f"; neither can the {len(errors) - 1} before it" if len(errors) > 1 else ""
    raise CheckpointError(f"{errors[0]}{others}") from errors[0]


def read_checkpoint(folder: Path) -> tuple[dict[str, Array], Manifest]:
    """Return arrays and manifest of one checkpoint. Raises CheckpointError unless it is whole."""
    try:
        text = read_file(folder / MANIFEST, MAX_TEXT_BYTES)
        _check_format(folder, text)
        manifest = Manifest.model_validate_json(text)
        data = read_file(folder / ARRAYS, manifest.arrays_bytes)
        if read_file(folder / SUMS, MAX_TEXT_BYTES) != _sums(data, text):
            raise CheckpointError(f"{folder} is damaged: its files do not match {SUMS}")
        if folder.name not in (BEST, f"{manifest.timesteps:012d}"):
            raise CheckpointError(f"{folder} holds the checkpoint of {manifest.timesteps} timesteps; rename it")
        return load(data), manifest
    except (OSError, ValueError, SafetensorError, KeyError) as error:  # KeyError: a type that NumPy does not have
        raise CheckpointError(f"{folder} cannot be read: {_explain(error)}") from error


def checkpoints(run: Path) -> list[Path]:
    """Return the folders of a run's checkpoints, oldest first: those named by twelve digits, and no links."""
    folders = (run / "checkpoints").glob("[0-9]" * 12)
    return sorted(path for path in folders if path.is_dir() and not path.is_symlink())


def has_checkpoint(run: Path) -> bool:
    """Return whether a run has saved anything."""
    return bool(checkpoints(run))


def best_score(run: Path) -> float | None:
    """Return the score of a run's best checkpoint, None if there is none that is whole."""
    try:
        return load_checkpoint(run, BEST)[1].score
    except CheckpointError:
        return None


def _sums(arrays: bytes, manifest: bytes) -> bytes:
    """Return the content of SHA256SUMS."""
    files = ((arrays, ARRAYS), (manifest, MANIFEST))
    return "".join(f"{hashlib.sha256(data).hexdigest()}  {name}\n" for data, name in files).encode()


def _check_format(folder: Path, manifest: bytes) -> None:
    found = _Format.model_validate_json(manifest).format
    if found != FORMAT:
        raise CheckpointError(
            f"{folder} has format {found}, expected {FORMAT}; use the version of joybridge that wrote it, "
            "or train a new run"
        )


def _is_whole(folder: Path) -> bool:
    try:
        read_checkpoint(folder)
    except CheckpointError:
        return False
    return True


def _delete(folder: Path) -> None:
    """Delete a checkpoint; a folder with other files, or with the checkpoint of other timesteps, is somebody else's."""
    with suppress(OSError, ValidationError):
        manifest = Manifest.model_validate_json(read_file(folder / MANIFEST, MAX_TEXT_BYTES))
        names = {path.name for path in folder.iterdir()}
        if names <= {ARRAYS, MANIFEST, SUMS} and folder.name == f"{manifest.timesteps:012d}":
            _remove(folder)


def _remove(folder: Path) -> None:
    """Delete a folder so that no part of it is taken for a checkpoint, even if this process is killed meanwhile."""
    old = folder.with_name(".old")
    shutil.rmtree(old, ignore_errors=True)  # of a run that was killed
    folder.rename(old)
    shutil.rmtree(old)


@cache  # commands load a checkpoint twice
def _warn(text: str) -> None:
    log.warning("%s", text)


def _explain(error: Exception) -> str:
    """Return the reason of an error in a few words."""
    if isinstance(error, ValidationError):
        return f"{MANIFEST}: {reason_of(error)}"
    if isinstance(error, OSError):
        return f"{Path(str(error.filename)).name}: {error.strerror}" if error.filename else str(error)
    return f"{ARRAYS}: {error}"
