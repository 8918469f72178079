"""Exported policies that are damaged, huge or of another game, and wrong states of runs: a sentence each, or play."""

import base64
import io
import json
import os
import shutil
import time
from collections.abc import Iterator
from contextlib import redirect_stdout
from pathlib import Path
from random import Random
from typing import Any

import numpy as np

from joybridge.cli import main
from joybridge.client.client import Session
from joybridge.config.config import Config
from joybridge.config.policy_config import MemoryConfig, PolicyConfig
from joybridge.contract.errors import JoybridgeError
from joybridge.contract.tensors import Array
from joybridge.layouts import make_acts
from joybridge.policy.exported import Exported, load_exported
from joybridge.run.checkpoint import load_checkpoint, save_checkpoint
from joybridge.run.train import train
from joybridge.run.training import Audience
from tools.chaos.outcome import Outcome
from tools.chaos.process import Simulator, forget_peak, mebibytes

SMALL = PolicyConfig(
    hidden_sizes=[8],
    rollout_steps=8,
    time_horizon=8,
    minibatch_size=32,
    memory=MemoryConfig(kind="gru", size=4, length=4),
)
CONFIG = Config(game="noughts", arenas=4, total_timesteps=64, log_interval=64, policy=SMALL)
LONGEST = 10.0  # seconds for one file, on a busy machine
LARGEST = 300.0  # MiB
ARENAS, DECISIONS = 3, 4
STRANGE: tuple[Any, ...] = (-1, 0, 1, 2**40, 1e300, "", "x", [], {}, None, True, float("nan"), [[]])


def _floats(shape: list[int], values: Array) -> dict[str, Any]:
    return {"shape": shape, "float32": base64.b64encode(values.astype("<f4").tobytes()).decode()}


def _arrays(part: Any) -> Iterator[dict[str, Any]]:
    """Yield the arrays of a document."""
    if isinstance(part, dict) and "float32" in part:
        yield part
    elif isinstance(part, dict | list):
        for each in part.values() if isinstance(part, dict) else part:
            yield from _arrays(each)


def damaged(content: bytes, chance: Random) -> tuple[str, bytes]:
    """Return an exported policy with a fault in it, and what was done to it."""
    document = json.loads(content) if content[:1] == b"{" else None
    kind = chance.choice(["cut", "flip", "zeros"] + (["numbers", "sizes", "values"] if document else []))
    place = chance.randrange(len(content))
    match kind:
        case "cut":
            return kind, content[:place]
        case "flip":
            return kind, content[:place] + bytes([content[place] ^ 1 << chance.randrange(8)]) + content[place + 1 :]
        case "zeros":
            return kind, content[:place] + bytes(64) + content[place + 64 :]
        case "values":
            places: list[tuple[Any, Any]] = []
            parts: list[Any] = [document]
            while parts:
                part = parts.pop()
                for key in [*part] if isinstance(part, dict) else range(len(part)):
                    places.append((part, key))
                    if isinstance(part[key], dict | list):
                        parts.append(part[key])
            part, key = chance.choice(places)
            part[key] = chance.choice(STRANGE)
        case _:
            array = chance.choice([*_arrays(document)])
            size = int(np.prod(array["shape"]))
            if kind == "numbers":
                array.update(_floats(array["shape"], np.full(size, chance.choice([np.nan, np.inf, 1e38, -1e38]))))
            else:
                array["shape"] = chance.choice([[], [0], [2**31, 2**31], [*array["shape"], 1], [size + 1], [-1]])
    return kind, json.dumps(document).encode()


def play(exported: Exported, address: str) -> None:
    """Let a policy play some decisions in all lanes."""
    with Session(address, CONFIG.game, arenas=ARENAS, seed=1) as session:
        lanes = len(session.steps[0].rewards)
        player = exported.seat(lanes)
        player.rng = np.random.default_rng(0)
        player.begin(session.steps[0])
        for _ in range(DECISIONS):
            acts = make_acts(session.spec, ARENAS)
            step = session.steps[0]
            held = np.arange(lanes) if step.deciding is None else np.flatnonzero(step.deciding)
            player.act(step, acts[0], held)
            player.store(session.step(acts)[0], held)


def policies(folder: Path, faults: int) -> Outcome:
    """Play exported policies that are damaged, huge or of another game, and resume from wrong states of memory."""
    problems: list[str] = []
    longest = most = 0.0
    chance, own, refused = Random(0), os.getpid(), 0
    with Simulator() as simulator:
        address = simulator.address
        train(CONFIG, folder / "run", [address], resume=False, audience=Audience(say=lambda _: None))
        contents = {}
        for suffix in ("json", "onnx"):
            path = folder / f"policy.{suffix}"
            with redirect_stdout(io.StringIO()):
                main(["export", str(folder / "run"), str(path), "--simulator", address])
            contents[suffix] = path.read_bytes()
        with Session(address, CONFIG.game, arenas=1, seed=0) as session:
            spec = session.spec
        with Session(address, "recall", arenas=1, seed=0) as session:
            other = session.spec
        hole = folder / "hole.onnx"
        hole.touch()
        os.truncate(hole, 2**40)
        cases = [
            (f"{number}", *damaged(contents[suffix], chance), suffix)
            for number in range(faults)
            for suffix in ("json", "onnx")
        ]
        for number, kind, content, suffix in cases:
            path = folder / f"damaged.{suffix}"
            path.write_bytes(content)
            forget_peak(own)
            memory, begin = mebibytes(own), time.monotonic()
            said = ""
            try:
                play(load_exported(path, spec), address)
            except JoybridgeError as error:
                said, refused = str(error), refused + 1
            except Exception as error:
                problems.append(f"{suffix} {number}, {kind}: {error!r:.300}")
            seconds, used = time.monotonic() - begin, mebibytes(own, "VmHWM") - memory
            longest, most = max(longest, seconds), max(most, used)
            if not said.isprintable() or len(said) > 1000 or seconds > LONGEST or used > LARGEST:
                problems.append(f"{suffix} {number}, {kind}: {seconds:.1f} s, {used:.0f} MiB, {said[:300]!r}")
        for path, game in ((hole, spec), (folder / "policy.json", other), (folder / "policy.onnx", other)):
            try:
                load_exported(path, game)
                problems.append(f"{path.name} is played in {game.name}")
            except JoybridgeError:
                refused += 1
        wrong = wrong_states(folder, address, problems)
    figures = (
        f"{refused} of {len(cases) + 3} files refused, the others played legally, in {longest:.1f} s and {most:.0f} "
        f"MiB at most; {wrong} wrong states of runs refused"
    )
    return Outcome(len(cases) + 3 + wrong, problems, figures)


def wrong_states(folder: Path, address: str, problems: list[str]) -> int:
    """Resume from checkpoints with a wrong array, under hashes that are right; return how many."""
    arrays, manifest = load_checkpoint(folder / "run")
    places = [
        next(name for name in arrays if name.endswith(end))
        for end in ("/policy/memory", "/policy/observations", "/policy/network.actor.hidden.0.weight")
    ]
    cases: dict[tuple[str, str], Array] = {}
    for place in places:
        right = arrays[place]
        cases |= {
            (place, "NaN"): np.full_like(right, np.nan),
            (place, "infinite"): np.full_like(right, np.inf),
            (place, "another row"): np.zeros((right.shape[0] + 1, right.shape[1]), right.dtype),
            (place, "more columns"): np.zeros((right.shape[0], right.shape[1] + 3), right.dtype),
            (place, "one number"): np.zeros((), right.dtype),
            (place, "nothing"): right[:0],
        }
    config = CONFIG.model_copy(update={"total_timesteps": 2 * CONFIG.total_timesteps})
    for number, ((place, what), array) in enumerate(cases.items()):
        run = folder / f"wrong-{number}"
        shutil.copytree(folder / "run", run, ignore=shutil.ignore_patterns("checkpoints"))
        save_checkpoint(run, {**arrays, place: array}, manifest)
        try:
            train(config, run, [address], resume=True, audience=Audience(say=lambda _: None))
            problems.append(f"a run goes on from {place} that is wrong: {what}")
        except JoybridgeError as error:
            if not str(error).isprintable():
                problems.append(f"{place}, {what}: {error!s:.300}")
        except Exception as error:
            problems.append(f"{place}, {what}: {error!r:.300}")
    return len(cases)
