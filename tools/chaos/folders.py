"""Run folders and configurations of strangers: a sentence each, soon, without much memory; nothing is executed."""

import io
import json
import os
import time
from collections.abc import Callable
from contextlib import chdir, redirect_stderr, redirect_stdout
from pathlib import Path

import numpy as np

from joybridge.cli import main as trainer
from joybridge.config.config import Config
from joybridge.run.checkpoint import ARRAYS, MANIFEST, SUMS, Manifest, _sums, save_checkpoint
from joybridge.run.folder import keep_config
from tools.chaos.outcome import Outcome
from tools.chaos.process import forget_peak, mebibytes

PATIENCE = 5.0  # seconds on a busy machine; an idle one takes less than one
LARGEST = 200.0  # MiB
NAMES = "names-"  # what the folders of runs begin with that name simulators
LAUGHS = "game: g\noptions:\n  a0: &a0 ha\n" + "".join(
    f"  a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]\n" for i in range(1, 12)
)


def _pipe(path: Path) -> None:
    os.mkfifo(path)


def _hole(path: Path) -> None:
    path.touch()
    os.truncate(path, 2**40)


# What may stand in place of any file.
THINGS: dict[str, Callable[[Path], object]] = {
    "a pipe": _pipe,
    "/dev/zero": lambda path: path.symlink_to("/dev/zero"),
    "a folder": lambda path: path.mkdir(),
    "1 TB of zeros": _hole,
    "a link to itself": lambda path: path.symlink_to(path),
    "nothing": lambda path: path.write_bytes(b""),
    "garbage": lambda path: path.write_bytes(b"\x80\x04\xff\xfe\x00 garbage"),
}
CONFIGS = {
    "a bomb of aliases": LAUGHS,
    "deep nesting": "game: " + "[" * 30_000,
    "many digits": "game: g\nseed: " + "9" * 5000,
    "a tag that calls os.system": "game: !!python/object/apply:os.system [touch executed]",
    "a list": "- a",
    "extends a device": "game: g\nextends: /dev/zero",
    "extends itself": "extends: config.yaml",
}


def _manifest(**fields: object) -> bytes:
    return json.dumps({"format": 4, "timesteps": 5, "snapshots": None, "arrays_bytes": 10**6, **fields}).encode()


def _arrays(header: object) -> bytes:
    text = json.dumps(header).encode()
    return len(text).to_bytes(8, "little") + text


# What simulators.json may name. The test's folder has a program `player` and a module `stranger`.
NAMED: dict[str, dict[str, object]] = {
    "a program": {"games": ["unity:player wait=2"]},
    "a module": {"games": ["stranger:Stranger"]},
    "an environment of Gymnasium": {"games": ["gym:stranger:Env-v0"]},
    "an environment of PettingZoo": {"games": ["pettingzoo:stranger"]},
    "an address": {"addresses": ["127.0.0.1:1"], "token_file": "secret"},
    "a signature": {"games": ["stranger:Stranger"], "signature": "0" * 64},
}


# Arrays and manifest of checkpoints whose hashes are right.
SEALED = {
    "a list as manifest": (b"", b"[]"),
    "a number as manifest": (b"", b"7"),
    "a deep manifest": (b"", b"[" * 500_000),
    "words as timesteps": (b"", _manifest(timesteps="five")),
    "negative timesteps": (b"", _manifest(timesteps=-5)),
    "numbers as snapshots": (b"", _manifest(snapshots=[[1]])),
    "very many bytes": (b"", _manifest(arrays_bytes=2**62)),
    "a pickle": (b"\x80\x04cos\nsystem\n(S'touch executed'\ntR.", _manifest()),
    "a header of 2^63 bytes": ((2**63 - 1).to_bytes(8, "little"), _manifest()),
    "arrays of 4 TB": (_arrays({"a": {"dtype": "F32", "shape": [2**40], "data_offsets": [0, 2**42]}}), _manifest()),
    "no arrays": (_arrays({}), _manifest()),
    "arrays of another network": (_arrays({"a": {"dtype": "U8", "shape": [0], "data_offsets": [0, 0]}}), _manifest()),
}


def new_run(run: Path) -> Path:
    """Write a run with one checkpoint, and return the folder of that."""
    keep_config(Config(game="orchard"), run)
    return save_checkpoint(run, {"a": np.zeros(3)}, Manifest(timesteps=5))


def visit(run: Path) -> tuple[int, str]:
    """Evaluate a run of a stranger; return exit status and what it printed."""
    said = io.StringIO()
    elsewhere = [] if run.name.startswith(NAMES) else ["--simulator", "127.0.0.1:1", "--wait", "0.01"]
    with redirect_stderr(said), redirect_stdout(said):
        status = trainer(["evaluate", str(run), "--episodes", "1", *elsewhere])
    return status, said.getvalue()


def strange_runs(folder: Path) -> dict[str, Path]:
    """Write all runs of strangers; return them by name."""
    runs: dict[str, Path] = {}

    def new(name: str) -> tuple[Path, Path]:
        runs[name] = folder / f"run-{len(runs)}"
        return runs[name], new_run(runs[name])

    for file in ("config.yaml", "simulators.json", "checkpoints", ARRAYS, MANIFEST, SUMS):
        for name, put in THINGS.items():
            run, checkpoint = new(f"{name} as {file}")
            path = (checkpoint if file in (ARRAYS, MANIFEST, SUMS) else run) / file
            if path.is_dir():
                path.rename(run / "elsewhere")
            else:
                path.unlink(missing_ok=True)
            put(path)
    for name, text in CONFIGS.items():
        (new(f"configuration: {name}")[0] / "config.yaml").write_text(text)
    for name, (arrays, manifest) in SEALED.items():
        _, checkpoint = new(f"checkpoint: {name}")
        for file, data in ((ARRAYS, arrays), (MANIFEST, manifest), (SUMS, _sums(arrays, manifest))):
            (checkpoint / file).write_bytes(data)
    for name, notes in NAMED.items():
        run = runs[f"simulators.json names {name}"] = folder / f"{NAMES}{len(runs)}"
        new_run(run)
        (run / "simulators.json").write_text(json.dumps(notes))
    return runs


def folders(folder: Path, faults: int) -> Outcome:
    """Evaluate run folders of strangers (devices, pipes, bombs, wrong types), all of them so many times."""
    problems = []
    longest = most = 0.0
    with chdir(folder):  # where code that is executed would leave its file
        Path("player").write_text("#!/bin/sh\ntouch executed\n")
        Path("player").chmod(0o700)
        Path("stranger.py").write_text("open('executed', 'w').close()")
        Path("secret").write_text("a secret of the user")
        visit(new_run(folder / "first").parent.parent)  # imports what it needs
        runs = strange_runs(folder)
        for name, run in [*runs.items()] * faults:
            forget_peak(os.getpid())
            memory, begin = mebibytes(os.getpid()), time.monotonic()
            try:
                status, said = visit(run)
            except Exception as error:
                status, said = -1, repr(error)
            seconds, used = time.monotonic() - begin, mebibytes(os.getpid(), "VmHWM") - memory
            longest, most = max(longest, seconds), max(most, used)
            errors = [line for line in said.splitlines() if line.startswith("error: ")]
            right = status in (1, 2) and len(errors) == 1 and errors[0].isprintable() and "Traceback" not in said
            if not right or seconds > PATIENCE or used > LARGEST:
                problems.append(f"{name}: status {status}, {seconds:.1f} s, {used:.0f} MiB, {said[-300:]!r}")
    if list(folder.rglob("executed")):
        problems.append("something was executed")
    figures = f"{len(runs)} folders, a sentence each, in {longest:.2f} s and {most:.0f} MiB at most"
    return Outcome(len(runs) * faults, problems, figures)
