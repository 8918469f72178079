"""Hold `joybridge mlagents` to the real `mlagents_envs` 1.1.0: it drives our games and sees what our client sees.

Four games are driven over localhost: masks, hybrid actions, turns, two behaviors, ends of both kinds, side channels.
Then the same actions are played through our own client, and everything is compared to the bit. At last it is timed,
with 64 agents; and so is the player alone, under a trainer that does nothing, because most of that time is that of
`mlagents_envs`. A file `.demo` that the real `mlagents` writes is read here as `mlagents` itself reads it.

`mlagents_envs` needs Python 3.10. It is installed into `.venv-mlagents` once. Exit status: 0; 1 at the first failure;
77 before it begins, where Python 3.10 or the package cannot be had.
"""

import argparse
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import grpc
import numpy as np

from joybridge.client.client import Session
from joybridge.client.launch import simulator_process
from joybridge.contract.codec import StepArrays
from joybridge.contract.tensors import Array
from joybridge.demonstrations.episodes import Episode, finished_episodes
from joybridge.demonstrations.files import load_demonstration
from joybridge.demonstrations.recorded import load_recorded
from joybridge.layouts import make_acts
from joybridge.layouts.random_acts import obey_masks, press_at_random
from joybridge.mlagents import communicator_pb2 as ml
from joybridge.mlagents.wire import ANY_LENGTH, END, FINE, METHOD, SERVICE, VERSION
from joybridge.policy.encoder import ObservationEncoder
from joybridge.v1 import bridge_pb2 as pb
from tools.check_wheel import find_python
from tools.checked import MISSING, Failed, make_environment

ROOT = Path(__file__).resolve().parents[1]
ENVIRONMENT = ROOT / ".venv-mlagents"  # which git ignores
# mlagents-envs declares Python <= 3.10.12 and works with later ones, so it is installed without its requirements.
REQUIREMENTS = (
    "setuptools<81",
    "numpy==1.23.5",
    "protobuf==3.20.3",
    "grpcio==1.48.2",
    "Pillow",
    "pyyaml",
    "cloudpickle",
    "filelock",
)
DRIVEN = "mlagents_envs.environment, mlagents.trainers"  # modules that drive a player and read demonstrations
PACKAGES = ("mlagents-envs==1.1.0", "mlagents==1.1.0")
GAMES = ("archer", "noughts", "ferry", "shooting_birds")
TIMED = "shooting_birds"
DEMONSTRATED, DEMONSTRATED_STEPS = "archer", 300  # a game with an axis, a branch and masks
SEED, ARENAS, RESET_AT, STEPS = 3, 4, 70, 120  # as in tools/mlagents/drive.py
PARAMETERS: Mapping[str, tuple[str, tuple[float, float]]] = {"shooting_birds": ("bird_speed", (0.5, 1.5))}
TIMED_ARENAS, TIMED_STEPS = 64, 400
DEADLINE = 300.0  # seconds of one command


def main() -> int:
    """Check the player and return the exit status."""
    argparse.ArgumentParser(description="Check joybridge mlagents against the real mlagents_envs.").parse_args()
    begin = time.monotonic()
    if reason := install():
        print(f"not checked: {reason}")
        return MISSING
    try:
        with simulator_process() as simulator, tempfile.TemporaryDirectory() as folder:
            print(drive(simulator, Path(folder)), "of the real mlagents_envs, with 64 agents")
            for game in GAMES:
                with np.load(Path(folder) / f"{game}.npz") as archive:
                    steps = compare(simulator, game, dict(archive))
                print(f"{game}: {steps} decisions and ends of agents are equal to the bit")
            print(demonstrate(simulator, Path(folder)), "are the same to mlagents and here")
            print(f"{measure(simulator):.0f} agent-steps/s of the player alone, with {TIMED_ARENAS} agents")
    except Failed as failure:
        print(f"failed: {failure}", file=sys.stderr)
        return 1
    print(f"the real mlagents_envs drives our games ({time.monotonic() - begin:.0f} s)")
    return 0


def install(environment: Path = ENVIRONMENT, requirements: Sequence[str] = REQUIREMENTS, modules: str = DRIVEN) -> str:
    """Make the environment with these modules where it is not there yet; return why it cannot be had, "" if it is."""
    python = environment / "bin/python"
    if python.exists() and not subprocess.run([python, "-c", f"import {modules}"], check=False).returncode:
        return ""
    base = find_python("3.10")
    if base is None:
        return "mlagents-envs 1.1.0 needs Python 3.10, which is not installed here"
    alone = ["--no-deps", "--ignore-requires-python", *PACKAGES]
    problem = make_environment(environment, str(base), requirements, alone)
    return f"{' and '.join(PACKAGES)} cannot be installed: {problem}" if problem else ""


def drive(simulator: str, folder: Path) -> str:
    """Drive the games by the real package; return the last line that it prints. Raises Failed."""
    ports = free_ports(len(GAMES) + 1)
    with ExitStack() as resources:
        for game, port in zip((*GAMES, TIMED), ports, strict=True):
            resources.enter_context(player(simulator, game, port))
        games = [f"{game}:{port}" for game, port in zip((*GAMES, TIMED), ports, strict=True)]
        command = [str(ENVIRONMENT / "bin/python"), str(ROOT / "tools/mlagents/drive.py"), str(folder), *games]
        done = subprocess.run(command, capture_output=True, text=True, timeout=DEADLINE, check=False)
    if done.returncode:
        raise Failed(f"{' '.join(command)} ended with {done.returncode}:\n{done.stdout}{done.stderr}")
    if "WARNING" in done.stderr + done.stdout:
        raise Failed(f"mlagents_envs warned:\n{done.stdout}{done.stderr}")
    return done.stdout.strip().splitlines()[-1]


@contextmanager
def player(simulator: str, game: str, port: int) -> Iterator[None]:
    """Run `joybridge mlagents` in the block, at the end of which it must have ended by itself. Raises Failed."""
    command = [sys.executable, "-m", "joybridge", "mlagents", game, "--simulator", simulator, "--port", str(port)]
    with subprocess.Popen([*command, "--wait", str(DEADLINE)], stderr=subprocess.PIPE, text=True) as process:
        try:
            yield
            _, said = process.communicate(timeout=DEADLINE)
        finally:
            process.kill()
    if process.returncode or "the trainer has ended after" not in said:
        raise Failed(f"{' '.join(command)} ended with {process.returncode}:\n{said}")


def free_ports(count: int) -> list[int]:
    """Return ports of this machine that nobody uses."""
    with ExitStack() as sockets:
        bound = [sockets.enter_context(socket.socket()) for _ in range(count)]
        for one in bound:
            one.bind(("127.0.0.1", 0))
        return [one.getsockname()[1] for one in bound]


def compare(simulator: str, game: str, record: Mapping[str, Array]) -> int:
    """Play the recorded actions through our own client; return how many agents were compared. Raises Failed."""
    name, values = PARAMETERS.get(game, ("", (0.0, 0.0)))
    first, second = ({name: value} if name else {} for value in values)
    compared, told = 0, dict[str, list[float]]()
    with Session(simulator, game, arenas=ARENAS, seed=SEED, parameters=first) as session:
        spec, steps = session.spec, session.steps
        encoders = [ObservationEncoder(one.name, one, None, {}) for one in spec.behaviors]
        for number in range(STEPS):
            if number == RESET_AT:
                steps = session.reset(None, second)
            acts = make_acts(spec, ARENAS)
            for behavior, encoder, step, act in zip(spec.behaviors, encoders, steps, acts, strict=True):
                key = f"{number}/{behavior.name}"
                if f"{key}/ids" not in record:  # not announced yet, because no agent of it has been asked
                    continue
                asked = np.arange(len(step.rewards)) if step.deciding is None else np.flatnonzero(step.deciding)
                for what, wanted in expected(step, asked, encoder.rewards(step)):
                    came = record[f"{key}/{what}"]
                    if came.tobytes() != wanted.astype(came.dtype).reshape(came.shape).tobytes():
                        raise Failed(f"{game}: {key}/{what} is {came.tolist()}, expected {wanted.tolist()}")
                compared += len(asked) + len(step.ended)
                if len(asked):
                    act.axes[asked] = record[f"{key}/continuous"]
                    act.choices[asked] = record[f"{key}/discrete"]
            steps = session.step(acts)
            for behavior, step in zip(spec.behaviors, steps, strict=True):
                for row in () if step.metrics is None else step.metrics.tolist():
                    for metric, value in zip(behavior.metrics, row, strict=True):
                        told.setdefault(f"statistics/{behavior.name}/{metric.name}", []).append(value)
    for statistic, metrics in told.items():
        if record.get(statistic, np.empty(0)).tolist() != metrics:
            raise Failed(f"{game}: {statistic} are {record.get(statistic)}, expected {metrics}")
    return compared


def expected(step: StepArrays, asked: Array, rewards: Array) -> Iterator[tuple[str, Array]]:
    """Yield what `mlagents_envs` must have seen, by the name in the record."""
    earned = rewards.copy()
    earned[step.ended] = 0.0
    yield "reward", earned[asked]
    yield "ended_reward", rewards[step.ended]
    yield "interrupted", step.truncated[step.ended]
    for index, sensor in enumerate(step.observations):
        yield f"obs{index}", sensor[asked].astype(np.float32)
        if len(step.ended) and step.final_observations is not None:
            yield f"final{index}", step.final_observations[index].astype(np.float32)
    for index, mask in enumerate(step.masks or ()):
        yield f"mask{index}", ~mask[asked]


def demonstrate(simulator: str, folder: Path) -> str:
    """Let the real package write and read what a game was; return what was compared. Raises Failed."""
    rng = np.random.default_rng(SEED)
    with Session(simulator, DEMONSTRATED, arenas=ARENAS, seed=SEED) as session:
        recorder = session.record_demonstration(folder / "demos")
        acts, (part,) = make_acts(session.spec, ARENAS), session.spec.behaviors
        for _ in range(DEMONSTRATED_STEPS):
            press_at_random(part.device, acts[0], rng)
            obey_masks(acts[0], session.steps[0], rng)
            session.step(acts)
    assert recorder.path
    ours = load_recorded(recorder.path, None)
    episodes = [one for stretch in ours.stretches for one in finished_episodes(stretch, 0)]
    given, file, read = folder / "given.npz", folder / "theirs.demo", folder / "read.npz"
    written = _rows(part, episodes)
    np.savez(given, **written)
    command = [str(ENVIRONMENT / "bin/python"), str(ROOT / "tools/mlagents/demonstration.py"), str(given), str(file)]
    done = subprocess.run([*command, str(read)], capture_output=True, text=True, timeout=DEADLINE, check=False)
    if done.returncode:
        raise Failed(f"{' '.join(command)} ended with {done.returncode}:\n{done.stdout}{done.stderr}")
    stretches = load_demonstration(file, ours.spec).stretches
    here = _rows(part, [one for stretch in stretches for one in finished_episodes(stretch, 0)])
    ordered = _rows(part, sorted(episodes, key=len))  # as they are here
    with np.load(read) as there:
        for name, values in there.items():
            if (values.reshape(written[name].shape) != written[name]).any() or (here[name] != ordered[name]).any():
                raise Failed(f"{DEMONSTRATED}: {name} of a file .demo is not what was written")
    return f"{DEMONSTRATED}: {sum(map(len, episodes))} decisions of {len(episodes)} episodes in a file .demo"


def _rows(behavior: pb.Behavior, episodes: Sequence[Episode]) -> dict[str, Any]:
    """Return episodes as a row per step of an agent, with the action that led to it."""
    rows: dict[str, list[Any]] = {name: [] for name in ("reward", "done", "interrupted", "id", "mask")}
    axes, choices = (np.zeros((1, len(part))) for part in (behavior.device.axes, behavior.device.branches))
    for number, one in enumerate(episodes):
        last = np.arange(len(one) + 1) == len(one)
        rows["reward"].append(np.append(0, one.rewards[:, 0]))
        rows["done"].append(last)
        rows["interrupted"].append(last & one.truncated)
        rows["id"].append(np.full(len(last), number))
        rows["mask"].append(~np.concatenate(one.masks or [], axis=1))
        for sensor, seen in zip(behavior.sensors, one.observations, strict=True):
            rows.setdefault(f"sensor {sensor.name}", []).append(seen)
        rows.setdefault("continuous", []).append(np.concatenate([axes, one.act.axes]))
        rows.setdefault("discrete", []).append(np.concatenate([choices, one.act.choices]).astype(np.int32))
    sizes = [len(branch.choices) for branch in behavior.device.branches]
    joined = {name: np.concatenate(parts) for name, parts in rows.items()}
    return joined | {"sizes": np.array(sizes), "behavior": np.array(behavior.name)}


def measure(simulator: str) -> float:
    """Return agent-steps per second of the player under a trainer that always sends the same actions. Raises Failed."""
    action = ml.Action(continuous=np.zeros(2, "<f4").tobytes(), discrete=[0, 0])
    actions = {"hunter": ml.ActionList(actions=[action] * TIMED_ARENAS).SerializeToString()}
    hello = ml.TrainerHello(seed=SEED, communication_version=VERSION, num_areas=TIMED_ARENAS)
    first = [ml.FromTrainer(hello=hello), ml.FromTrainer(step=ml.TrainerStep(command=ml.RESET))]
    step = _reply(ml.FromTrainer(step=ml.TrainerStep(actions=actions)))
    replies = [*map(_reply, first), *[step] * TIMED_STEPS, ml.Message(header=ml.Header(status=END)).SerializeToString()]
    times = []

    def exchange(message: bytes, context: Any) -> bytes:
        times.append(time.perf_counter())
        return replies[len(times) - 1]

    with ThreadPoolExecutor(1) as pool:
        listener = grpc.server(pool, options=ANY_LENGTH)
        handler = grpc.unary_unary_rpc_method_handler(exchange)
        listener.add_generic_rpc_handlers([grpc.method_handlers_generic_handler(SERVICE, {METHOD: handler})])
        port = listener.add_insecure_port("127.0.0.1:0")
        listener.start()
        with player(simulator, TIMED, port):
            pass
        listener.stop(None).wait()
    return TIMED_ARENAS * TIMED_STEPS / (times[-1] - times[-TIMED_STEPS - 1])


def _reply(content: ml.FromTrainer) -> bytes:
    return ml.Message(header=ml.Header(status=FINE), from_trainer=content).SerializeToString()


if __name__ == "__main__":
    sys.exit(main())
