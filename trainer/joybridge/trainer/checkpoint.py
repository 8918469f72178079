"""Checkpoints: safetensors for arrays, JSON for the rest, written so that a crash never leaves half of one.

A run's `checkpoints/` holds one folder per checkpoint, named by its timesteps; the last two are kept.
"""

import json
import os
import shutil
from pathlib import Path
from typing import Any

from safetensors import SafetensorError
from safetensors.numpy import load_file, save

from joybridge.contract.tensors import Array

KEPT = 2
FORMAT = 2


class CheckpointError(Exception):
    """A checkpoint that is missing or cannot be read; the text names the file and what to do."""


def save_checkpoint(run: Path, arrays: dict[str, Array], manifest: dict[str, Any]) -> Path:
    """Write a checkpoint atomically, forget those before the last two, and return its folder.

    manifest must hold "timesteps".
    """
    folder = run / "checkpoints"
    target = folder / f"{manifest['timesteps']:012d}"
    fresh = folder / f".{target.name}.new"
    shutil.rmtree(fresh, ignore_errors=True)
    fresh.mkdir(parents=True)
    _write(fresh / "arrays.safetensors", save(arrays))
    _write(fresh / "manifest.json", json.dumps({"format": FORMAT} | manifest, indent=1).encode())
    _sync(fresh)
    if target.exists():  # the same boundary once more, of the same bytes
        shutil.rmtree(fresh)
    else:
        fresh.rename(target)
    _sync(folder)
    for old in _folders(run)[:-KEPT]:
        shutil.rmtree(old)
    return target


def load_checkpoint(run: Path) -> tuple[dict[str, Array], dict[str, Any]]:
    """Return arrays and manifest of the newest checkpoint. Raises CheckpointError."""
    folders = _folders(run)
    if not folders:
        raise CheckpointError(f"{run} holds no checkpoint; train it first, or name another run")
    newest = folders[-1]
    try:
        manifest = json.loads((newest / "manifest.json").read_text())
        arrays = load_file(newest / "arrays.safetensors")
    except (OSError, ValueError, SafetensorError) as error:
        raise CheckpointError(f"{newest} cannot be read ({error}); delete it to use the one before") from error
    if manifest.get("format") != FORMAT:
        raise CheckpointError(f"{newest} has format {manifest.get('format')}, expected {FORMAT}")
    return arrays, manifest


def has_checkpoint(run: Path) -> bool:
    """Return whether a run can be resumed."""
    return bool(_folders(run))


def _folders(run: Path) -> list[Path]:
    return sorted(path for path in (run / "checkpoints").glob("[0-9]*") if path.is_dir())


def _write(path: Path, data: bytes) -> None:
    with path.open("wb") as file:
        file.write(data)
        file.flush()
        os.fsync(file.fileno())


def _sync(folder: Path) -> None:
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def select(arrays: dict[str, Array], prefix: str) -> dict[str, Array]:
    """Return the arrays whose names begin with `prefix`, without it."""
    return {name.removeprefix(prefix): array for name, array in arrays.items() if name.startswith(prefix)}
