"""Checkpoints whose writing is killed, and checkpoints that are damaged afterwards."""

import multiprocessing
import random
import time
from collections import Counter
from functools import partial
from pathlib import Path

import numpy as np

from joybridge.config.errors import CheckpointError
from joybridge.run.checkpoint import Manifest, checkpoints, load_checkpoint, read_checkpoint, save_checkpoint
from tools.chaos.outcome import Outcome
from tools.chaos.process import wait_until

LONGEST_LIFE = 0.03  # seconds that a process saves before it is killed


def content(timesteps: int) -> dict[str, np.ndarray]:
    """Return the arrays of a checkpoint, which depend on its timesteps."""
    return {"weights": np.full((64, 256), timesteps, np.float32), "count": np.array(timesteps)}


def save_without_end(run: Path, timesteps: int) -> None:
    """Save checkpoints, one after the other."""
    while True:
        timesteps += 1
        save_checkpoint(run, content(timesteps), Manifest(timesteps=timesteps))


def has_moved_on(run: Path, timesteps: int) -> bool:
    """Return whether a run has a newer checkpoint than that of so many timesteps."""
    return int(checkpoints(run)[-1].name) > timesteps


def saves(folder: Path, faults: int) -> Outcome:
    """Kill processes that save: the newest checkpoint is whole each time, whatever the kill has left beside it."""
    context = multiprocessing.get_context("forkserver")  # a small process, without gRPC's threads, forks quickly
    context.set_forkserver_preload(["tools.chaos.checkpoints"])
    chance, problems, left = random.Random(0), [], Counter[str]()
    timesteps = 1
    save_checkpoint(folder, content(timesteps), Manifest(timesteps=timesteps))
    for number in range(faults):
        process = context.Process(target=save_without_end, args=(folder, timesteps), daemon=True)
        process.start()
        wait_until(partial(has_moved_on, folder, timesteps))
        time.sleep(chance.uniform(0.0, LONGEST_LIFE))
        process.kill()
        process.join()
        left.update(path.name for path in (folder / "checkpoints").iterdir() if path.name.startswith("."))
        arrays, manifest = load_checkpoint(folder)
        newest = int(checkpoints(folder)[-1].name)
        right = content(manifest.timesteps)
        if manifest.timesteps != newest or any((arrays[name] != right[name]).any() for name in right):
            problems.append(f"kill {number}: loaded {manifest.timesteps}, the newest is {newest}")
        timesteps = manifest.timesteps
    figures = (
        f"{timesteps:,} checkpoints were written; {left['.new']:,} kills left a half-written one, {left['.old']:,} "
    )
    return Outcome(faults, problems, f"{figures}a half-deleted one, and the newest was whole each time")


def damages(folder: Path, faults: int) -> Outcome:
    """Flip a bit of a checkpoint, zero a part of it, or cut it: each is detected."""
    path = save_checkpoint(folder, content(5), Manifest(timesteps=5))
    files = {file: file.read_bytes() for file in path.iterdir()}
    chance, problems, kinds = random.Random(0), [], Counter[str]()
    while (number := sum(kinds.values())) < faults:
        file, data = chance.choice(list(files.items()))
        place = chance.randrange(len(data))
        kind = chance.choice(["flips", "zeros", "cuts"])
        if kind == "flips":
            damaged = data[:place] + bytes([data[place] ^ 1 << chance.randrange(8)]) + data[place + 1 :]
        elif kind == "zeros":
            damaged = data[:place] + bytes(len(data[place : place + 4096])) + data[place + 4096 :]
        else:
            damaged = data[:place]
        if damaged == data:  # there were zeros
            continue
        file.write_bytes(damaged)
        kinds[kind] += 1
        try:
            read_checkpoint(path)
            problems.append(f"damage {number}: {kind} at {place} of {file.name} was not detected")
        except CheckpointError:
            pass
        file.write_bytes(data)
    read_checkpoint(path)
    figures = ", ".join(f"{count} {kind}" for kind, count in kinds.items())
    return Outcome(faults, problems, f"{figures}, {faults - len(problems):,} detected")
