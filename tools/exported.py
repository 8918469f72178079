"""Exported policies beside the trainer: what they answer and score, and how long a decision takes.

python -m tools.exported answers runs/answers    every built-in game under every layout, 1 024 decisions each
python -m tools.exported scores runs/birds       scores of the trainer, ONNX Runtime and policy.py; times; sizes
"""

import argparse
import importlib.util
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from joybridge.client.client import Session
from joybridge.client.launch import simulator_process
from joybridge.config.config import load_config
from joybridge.config.config_files import find_config
from joybridge.contract.codec import ActArrays, StepArrays
from joybridge.games import BUILT_IN
from joybridge.play.evaluate import CONFIDENCE
from joybridge.play.export import export
from joybridge.play.playing import PlaySpec, open_play
from joybridge.policy.episodes import Episodes
from joybridge.policy.exported import Model
from joybridge.run.folder import play_config
from joybridge.run.train import train
from joybridge.run.training import Audience
from joybridge.v1 import bridge_pb2 as pb

RUNTIME = Path(__file__).parents[1] / "proto/examples/python/policy.py"
LAYOUTS = ("hybrid", "bucket-11", "bucket-11-mu", "ordinal-11", "joint-3", "squashed", "threshold-0.0", "multiagent")
BEHAVIORS = {"ferry": ("helmsman", "lookout")}  # other games have one
SHORT = ("total_timesteps=1", "arenas=8", "policy.rollout_steps=64", "policy.time_horizon=64", "policy.epochs=1")
LANES = (1, 75)  # whose decisions are timed
CALLS = 1000


class Plays(Protocol):
    """What plays a behavior."""

    def act(self, step: StepArrays) -> ActArrays:
        """Return actions for a step."""

    def store(self, after: StepArrays) -> None:
        """Take what followed."""


class Onnx:
    """A model in ONNX Runtime, with noise of its own."""

    def __init__(self, file: Path, behavior: pb.Behavior, lanes: int) -> None:
        """Begin new episodes."""
        self._model, self._lanes = Model(file.read_bytes(), behavior, lanes), lanes
        self._random = np.random.default_rng(5)

    def act(self, step: StepArrays) -> ActArrays:
        """Return actions for a step."""
        normal, uniform = (self._model.inputs.get(name, [0])[0] for name in ("normal", "uniform"))
        return self._model.act(
            step,
            self._random.standard_normal((self._lanes, normal), np.float32),
            self._random.random((self._lanes, uniform), np.float32),
        )

    def store(self, after: StepArrays) -> None:
        """Take what followed: episodes that end begin anew."""
        self._model.store(after)


class Json:
    """The runtime in NumPy that users copy."""

    def __init__(self, file: Path, behavior: pb.Behavior, lanes: int) -> None:
        """Begin new episodes."""
        self._policy: Any = _runtime().Policy(file)
        self._behavior, self._random = behavior, np.random.default_rng(5)
        self._state = self._policy.begin(lanes)

    def act(self, step: StepArrays) -> ActArrays:
        """Return actions for a step."""
        sensors = dict(zip([sensor.name for sensor in self._behavior.sensors], step.observations, strict=True))
        branches = [branch.name for branch in self._behavior.device.branches]
        masks = None if step.masks is None else dict(zip(branches, step.masks, strict=True))
        axes, choices, self._state = self._policy.act(sensors, self._state, self._random, masks)
        return ActArrays(axes, choices)

    def store(self, after: StepArrays) -> None:
        """Take what followed: episodes that end begin anew."""
        self._state[after.terminated | after.truncated] = 0.0


def _runtime() -> Any:
    spec = importlib.util.spec_from_file_location("policy", RUNTIME)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def answers(folder: Path, games: Sequence[str], layouts: Sequence[str]) -> None:
    """Train, export and compare each game under each layout; print a line each. Raises ExportError."""
    with simulator_process() as address:
        for game in games:
            for layout in layouts:
                run = folder / game / layout
                config = load_config(find_config(f"{game}/hybrid"), [*SHORT, f"layout={layout}"])
                config = config.model_copy(update={"policies": {}})  # settings by names that `multiagent` changes
                train(config, run, [address], resume=False, audience=Audience(say=lambda text: None))
                for behavior in BEHAVIORS.get(game, ("",)):
                    file = run / f"{behavior or 'policy'}.onnx"
                    print(export(PlaySpec(run, address, seed=1), file, behavior=behavior), flush=True)


def scores(run: Path, episodes: int) -> None:
    """Print what a run's policy scores in each way to play it, and what each costs."""
    files = {"ONNX Runtime": run / "exported.onnx", "policy.py": run / "exported.json"}
    with simulator_process() as address:
        for file in files.values():
            print(export(PlaySpec(run, address, seed=1), file, behavior=""))
        print(f"trainer: reward {score(run, address, None, episodes)}", flush=True)
        for name, file in files.items():
            print(f"{name}: reward {score(run, address, file, episodes)}", flush=True)
        for name, file in files.items():
            times = ", ".join(f"{latency(run, address, file, lanes):.0f} µs for {lanes}" for lanes in LANES)
            print(f"{name}: {times} lanes; {file.stat().st_size / 1000:.0f} kB")


def score(run: Path, address: str, file: Path | None, episodes: int) -> str:
    """Return mean and 95 % interval of the first episode of each lane. file: None lets the trainer play."""
    with open_play(PlaySpec(run, address, seed=7), episodes=episodes, arenas_limit=episodes) as play:
        (player,) = play.players
        (behavior,) = play.spec.behaviors
        table = Episodes(player.lanes, [metric.name for metric in behavior.metrics])
        done = np.zeros(player.lanes, bool)
        model = player_of(file, behavior, player.lanes) if file else None
        decisions = play.decisions()
        while not done.all():
            if model is None:
                after = next(decisions).after
            else:
                after = play.session.step([model.act(play.session.steps[0])])
                model.store(after[0])
            table.add(after[0], player.actor.encoder.rewards(after[0]))
            done[after[0].ended] = True
    first = np.unique(table.finished[:, 0], return_index=True)[1]  # in the order in which they ended
    rewards = table.finished[first, 1]
    width = CONFIDENCE * rewards.std(ddof=1) / len(rewards) ** 0.5
    return f"{rewards.mean():.2f} ± {width:.2f} ({len(rewards)} episodes)"


def latency(run: Path, address: str, file: Path, lanes: int) -> float:
    """Return the median time of a decision of so many lanes at once, in µs."""
    config = play_config(run, ())
    with Session(address, config.game, arenas=lanes, seed=7, options=config.options) as session:
        (behavior,), (step,) = session.spec.behaviors, session.steps
    model = player_of(file, behavior, lanes)
    times = []
    for _ in range(CALLS):
        begin = time.perf_counter()
        model.act(step)
        times.append(time.perf_counter() - begin)
    return float(np.median(times)) * 1e6


def player_of(file: Path, behavior: pb.Behavior, lanes: int) -> Plays:
    """Return what plays an exported file."""
    return (Onnx if file.suffix == ".onnx" else Json)(file, behavior, lanes)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(prog="python -m tools.exported")
    commands = parser.add_subparsers(dest="command", required=True)
    answer = commands.add_parser("answers", help="compare with the trainer, decision by decision")
    answer.add_argument("folder", type=Path, help="for runs and exported policies")
    answer.add_argument("--games", nargs="+", choices=sorted(BUILT_IN), default=sorted(BUILT_IN))
    answer.add_argument("--layouts", nargs="+", default=LAYOUTS)
    scoring = commands.add_parser("scores", help="play whole episodes of a game with one behavior")
    scoring.add_argument("run", type=Path, help="folder of a run")
    scoring.add_argument("--episodes", type=int, default=210, help="default: %(default)s")
    options = parser.parse_args(arguments)
    if options.command == "answers":
        answers(options.folder, options.games, options.layouts)
    else:
        scores(options.run, options.episodes)


if __name__ == "__main__":
    main()
