"""Checkpoints: safetensors for arrays, JSON for the rest, written so that a crash never leaves half of one.

A run's `checkpoints/` holds one folder per checkpoint, named by its timesteps; the last two are kept.
"""

import json
import shutil
from pathlib import Path
from typing import Any

from safetensors import SafetensorError
from safetensors.numpy import load_file, save

from joybridge.contract.tensors import Array
from joybridge.trainer.errors import CheckpointError
from joybridge.trainer.files import sync_folder, write_synced

KEPT = 2
FORMAT = 3


def save_checkpoint(run: Path, arrays: dict[str, Array], manifest: dict[str, Any]) -> Path:
    """Write a checkpoint atomically, forget those before the last two, and return its folder.

    manifest must hold "timesteps".
    """
    folder = run / "checkpoints"
    target = folder / f"{manifest['timesteps']:012d}"
    if target.exists():  # the run has not moved on since its last checkpoint
        return target
    temporary = folder / f".{target.name}.new"
    shutil.rmtree(temporary, ignore_errors=True)
    temporary.mkdir(parents=True)
    write_synced(temporary / "arrays.safetensors", save(arrays))
    write_synced(temporary / "manifest.json", json.dumps({"format": FORMAT} | manifest, indent=1).encode())
    sync_folder(temporary)
    temporary.rename(target)
    sync_folder(folder)
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
        raise CheckpointError(
            f"{newest} has format {manifest.get('format')}, expected {FORMAT}; use the version of "
            "joybridge that wrote it, or train a new run"
        )
    return arrays, manifest


def has_checkpoint(run: Path) -> bool:
    """Return whether a run can be resumed."""
    return bool(_folders(run))


def _folders(run: Path) -> list[Path]:
    return sorted(path for path in (run / "checkpoints").glob("[0-9]*") if path.is_dir())


def select(arrays: dict[str, Array], prefix: str) -> dict[str, Array]:
    """Return the arrays whose names begin with `prefix`, without it."""
    return {name.removeprefix(prefix): array for name, array in arrays.items() if name.startswith(prefix)}
