"""How fast it is on this machine: medians over windows, with their spread.

python -m tools.bench [simulator | pictures | wire | learner | train | start | peers | all] [--json]

simulator   a game alone, in this process, by number of arenas
pictures    the images that agents observe, beside a bare write of as many bytes
wire        simulator process and client with random actions, and the round trip of one arena beside a bare echo
learner     sample passes of an update, beside the bare matrix products of the same shapes; with images, beside the
            bare forward and backward passes of the network
train       all of it: what `joybridge train` reaches
start       seconds that a simulator takes, seconds until a run's first update, and memory of both (Linux)
peers       the same beside Stable-Baselines3's PPO and a Gymnasium AsyncVectorEnv, on the same game
"""

import argparse
import json
import math
import os
import platform
import socket
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from itertools import product
from pathlib import Path

import numpy as np
import torch
from gymnasium.vector import AsyncVectorEnv

from joybridge.client.client import Session
from joybridge.client.launch import simulator_process
from joybridge.config.config import load_config
from joybridge.config.policy_config import PolicyConfig
from joybridge.contract.codec import ActArrays
from joybridge.contract.memory import keep_memory
from joybridge.contract.spec import choose_options
from joybridge.games.pointer_game import PointerGame
from joybridge.gym import BridgeEnv
from joybridge.layouts import ActionSpace, make_layouts
from joybridge.ppo.convolutions import ImageEncoder
from joybridge.ppo.history import Window
from joybridge.ppo.images import Image
from joybridge.ppo.loss import Batch
from joybridge.ppo.networks import Network, Towers
from joybridge.ppo.observation_tensors import Observations
from joybridge.ppo.schedule import Coefficients
from joybridge.ppo.threads import use_one_thread
from joybridge.ppo.update import Learner, ppo_update
from joybridge.run.train import train
from joybridge.run.training import Audience
from joybridge.simulator.catalog import load_games
from joybridge.v1 import bridge_pb2 as pb

WINDOWS = 7
GAMES = ("shooting_birds", "beastly_rivals")
IMAGES: list[dict[str, str]] = [  # options of both games
    {"observation": "fovea"},
    {"observation": "fovea", "fovea_reach": "16"},
    {"observation": "screen", "screen_size": "48"},
    {"observation": "screen", "screen_size": "64"},
    {"observation": "screen", "screen_size": "84", "color": "rgb"},
]
CONFIGS = Path(__file__).resolve().parents[1] / "configs"
Figures = dict[str, dict[str, float]]  # what -> {"median", "low", "high"} per second, or seconds


def measure(work: Callable[[], float]) -> dict[str, float]:
    """Return median, lowest and highest rate over windows; `work` does a window's work and returns its size."""
    work()
    rates = []
    for _ in range(WINDOWS):
        begin = time.perf_counter()
        size = work()
        rates.append(size / (time.perf_counter() - begin))
    return {"median": statistics.median(rates), "low": min(rates), "high": max(rates)}


def random_acts(spec: pb.GameSpec, arenas: int, rng: np.random.Generator) -> list[list[ActArrays]]:
    """Return a few random actions for all lanes to play in turn."""
    device = spec.behaviors[0].device
    axes = [rng.uniform(-1, 1, (arenas, len(device.axes))).astype(np.float32) for _ in range(16)]
    choices = [rng.integers(0, 2, (arenas, len(device.branches))).astype(np.int32) for _ in range(16)]
    return [[ActArrays(a, c)] for a, c in zip(axes, choices, strict=True)]


def bench_simulator() -> Figures:
    """Agent-steps per second of the games alone, with random actions."""
    figures = {}
    for name, game_class in load_games().items():
        if name not in GAMES:
            continue
        for arenas in (1, 4, 16, 64, 256, 1024):
            options = choose_options(game_class.options, {}, name)
            game = game_class(options, {}, arenas, 0, 0)
            acts = random_acts(game_class.describe(options), arenas, np.random.default_rng(0))
            steps = max(20, 20_000 // arenas)

            def work(game=game, acts=acts, steps=steps, arenas=arenas) -> float:  # type: ignore[no-untyped-def]
                for step in range(steps):
                    game.step(acts[step % len(acts)])
                return float(steps * arenas)

            figures[f"{name}, {arenas} arenas, agent-steps/s"] = measure(work)
    return figures


def bench_pictures() -> Figures:
    """Microseconds of an image that an agent observes, of 150 arenas that play on between, and of writing its bytes."""
    figures, arenas, steps = {}, 150, 40
    games = load_games()
    for name, choices in product(GAMES, IMAGES):
        options = choose_options(games[name].options, choices, name)
        game = games[name](options, {}, arenas, 0, 0)
        assert isinstance(game, PointerGame)
        acts = random_acts(games[name].describe(options), arenas, np.random.default_rng(0))
        (image,) = game.observations(game.arenas)
        source, target = np.zeros_like(image), np.empty_like(image)
        seen, bare = [], []
        for step in range(2 * steps):
            game.step(acts[step % len(acts)])
            begin = time.perf_counter()
            game.observations(game.arenas)
            middle = time.perf_counter()
            np.copyto(target, source)
            bare.append((time.perf_counter() - middle) / arenas * 1e6)
            seen.append((middle - begin) / arenas * 1e6)
        size = "x".join(map(str, image.shape[1:]))
        figures[f"{name}, {' '.join(choices.values())} {size}, µs (p50, p5, p95)"] = _spread(seen[steps:])
        figures[f"{name}, {' '.join(choices.values())} {size}, bare write, µs"] = _spread(bare[steps:])
    return figures


def _spread(values: list[float]) -> dict[str, float]:
    median, low, high = np.percentile(values, (50, 5, 95)).tolist()
    return {"median": median, "low": low, "high": high}


def bench_wire() -> Figures:
    """Agent-steps per second through a simulator process, and round trips of one arena."""
    figures: Figures = {"an echo, round trip in µs (p50, p5, p95)": echo()}
    with simulator_process() as address:
        for name in GAMES:
            for arenas in (1, 64, 128, 256):
                with Session(address, name, arenas=arenas, seed=0) as session:
                    acts = random_acts(session.spec, arenas, np.random.default_rng(0))

                    def work(session=session, acts=acts, arenas=arenas) -> float:  # type: ignore[no-untyped-def]
                        for step in range(400):
                            session.step(acts[step % len(acts)])
                        return float(400 * arenas)

                    figures[f"{name}, {arenas} arenas, agent-steps/s"] = measure(work)
            figures[f"{name}, 1 arena, round trip in µs (p50, p5, p95)"] = round_trips(name, address)
            if hasattr(os, "SCHED_IDLE"):
                with _cores_kept_awake():
                    figures[f"{name}, 1 arena, round trip in µs, cores kept from halting"] = round_trips(name, address)
            figures |= _two_sessions(name, address, address, "in turns at one simulator")
            with simulator_process() as other:
                figures |= _two_sessions(name, address, other, "at two simulators")
    return figures


def round_trips(name: str, address: str) -> dict[str, float]:
    """Return percentiles of the microseconds that a decision of a single arena takes."""
    with Session(address, name, arenas=1, seed=0) as session:
        acts = random_acts(session.spec, 1, np.random.default_rng(0))
        return _percentiles(lambda step: session.step(acts[step % len(acts)]))


def echo() -> dict[str, float]:
    """Return the same for messages as long as those of Shooting Birds, between two processes that do nothing else."""
    request, response = bytes(40), bytes(549)
    ours, other = socket.socketpair()
    answer = f"""
import socket
with socket.socket(fileno={other.fileno()}) as other:
    while other.recv(65536):
        other.sendall(bytes({len(response)}))
"""
    with ours, subprocess.Popen([sys.executable, "-c", answer], pass_fds=[other.fileno()]) as process:
        other.close()

        def exchange(step: int) -> None:
            ours.sendall(request)
            ours.recv(65536)

        figures = _percentiles(exchange)
        ours.shutdown(socket.SHUT_RDWR)
        process.wait()
    return figures


def _percentiles(exchange: Callable[[int], object]) -> dict[str, float]:
    """Return percentiles of the microseconds that an exchange takes. It is given the number of the step."""
    trips = []
    for step in range(4000):
        begin = time.perf_counter()
        exchange(step)
        trips.append(time.perf_counter() - begin)
    low, median, high = np.percentile(trips[1000:], [5, 50, 95]) * 1e6
    return {"median": median, "low": low, "high": high}


@contextmanager
def _cores_kept_awake() -> Iterator[None]:
    """Keep every core busy at the lowest priority: waking one that halts is slow, most of all in a virtual machine."""
    idle = f"""
import os
os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))
while os.getppid() == {os.getpid()}: pass
"""
    command = [sys.executable, "-c", idle]
    spinning = [subprocess.Popen(command, start_new_session=True) for _ in range(os.cpu_count() or 1)]
    try:
        yield
    finally:
        for process in spinning:
            process.kill()
            process.wait()


def _two_sessions(name: str, first: str, second: str, how: str) -> Figures:
    """Measure 256 arenas in two sessions, where one is always being answered while the other is worked on."""
    with Session(first, name, arenas=128, seed=0) as one, Session(second, name, arenas=128, seed=0) as two:
        acts = random_acts(one.spec, 128, np.random.default_rng(0))
        one.send(acts[0])

        def work() -> float:
            for step in range(400):
                two.send(acts[step % len(acts)])
                one.receive()
                one.send(acts[step % len(acts)])
                two.receive()
            return 400.0 * 256

        figure = measure(work)
        one.receive()
    return {f"{name}, 2 x 128 arenas, {how}, agent-steps/s": figure}


def bench_learner() -> Figures:
    """Sample passes per second of an update of Shooting Birds bucket-11, batch 256, and of its matrix products."""
    use_one_thread()
    keep_memory()
    rows, minibatch, inputs, hidden = 4425, 256, 132, 100
    figures: Figures = {}
    layout = make_layouts("bucket-11", _device())[""]
    for shared in (True, False):
        body = "one tower" if shared else "two towers"
        networks = [Network(inputs, layout.space, Towers([hidden, hidden], shared), 0) for _ in range(3)]
        names = [str(branch) for branch in range(len(layout.space.branches))]
        ways = ("autograd", "closed form", "closed form with two threads")
        learners = {
            name: Learner(
                name,
                network,
                branches=names,
                gaussians=[],
                autograd=name == "autograd",
                threads=2 if "threads" in name else 1,
            )
            for name, network in zip(ways, networks, strict=True)
        }
        batch = random_batch(Observations(torch.randn(rows, inputs)), rows)

        for name, learner in learners.items():

            def work(learner=learner, batch=batch) -> float:  # type: ignore[no-untyped-def]
                ppo_update(
                    learner,
                    batch,
                    Coefficients(3e-4, 0.2, 0.05),
                    PolicyConfig(epochs=4, minibatch_size=minibatch),
                    np.random.default_rng(0),
                )
                return 4.0 * (rows // minibatch) * minibatch

            figures[f"{name}, {body}, sample passes/s"] = measure(work)
        actor, critic = networks[0].actor, networks[0].critic
        outputs = [tower.head.weight for tower in (actor, critic) if tower]
        figures[f"bare matrix products, {body}, sample passes/s"] = measure(
            lambda outputs=outputs: _products(outputs, minibatch, inputs, hidden)  # type: ignore[misc]
        )
        bare = figures[f"bare matrix products, {body}, sample passes/s"]["median"]
        for way in ways[1:]:
            ratio = figures[f"{way}, {body}, sample passes/s"]["median"] / bare
            figures[f"{way} / bare products, {body}"] = {"median": ratio, "low": ratio, "high": ratio}
    return figures | _image_learner(layout.space)


def random_batch(observations: Observations, rows: int) -> Batch:
    """Return a minibatch of random advantages and values under three branches."""
    return Batch(
        observations,
        torch.zeros(rows, 0),
        torch.zeros(rows, 3, dtype=torch.long),
        None,
        torch.full((rows,), -5.9),
        torch.randn(rows),
        torch.randn(rows),
        torch.randn(rows),
    )


def _image_learner(space: ActionSpace) -> Figures:
    """Sample passes per second of an update from two images of 32 x 32, and of the bare passes of its network."""
    rows, minibatch, images, rng = 3072, 1024, [Image(32, 32, 1)] * 2, np.random.default_rng(0)
    network = Network(0, space, Towers([128, 128], True, "relu"), 0, [ImageEncoder("auto", images, 0, 1, "relu")])
    names = [str(branch) for branch in range(len(space.branches))]
    learner = Learner("player", network, branches=names, gaussians=[], autograd=False)
    bytes_of_all = [rng.integers(0, 256, (rows, 1, *image.shape), np.uint8) for image in images]
    windows = tuple(Window(each, np.arange(rows)[:, None], np.zeros(rows, np.int64)) for each in bytes_of_all)
    batch = random_batch(Observations(torch.zeros(rows, 0), windows), rows)
    seen = batch.observations.index_select(0, torch.arange(minibatch))

    def update() -> float:
        settings = PolicyConfig(epochs=1, minibatch_size=minibatch)
        ppo_update(learner, batch, Coefficients(1e-3, 0.2, 0.02), settings, np.random.default_rng(0))
        return float(rows)

    def bare() -> float:
        for _ in range(rows // minibatch):
            logits, _, value = network(seen)
            (logits[:, :, :3].sum() + value.sum()).backward()
        return float(rows)

    figures = {"two images, sample passes/s": measure(update), "two images, bare passes/s": measure(bare)}
    ratio = figures["two images, sample passes/s"]["median"] / figures["two images, bare passes/s"]["median"]
    return figures | {"two images / bare passes": {"median": ratio, "low": ratio, "high": ratio}}


def _products(heads: list[torch.Tensor], minibatch: int, inputs: int, hidden: int) -> float:
    """Run the matrix products of forward and backward passes, nothing else."""
    x, g1, g2 = torch.randn(minibatch, inputs), torch.randn(minibatch, hidden), torch.randn(minibatch, hidden)
    w1, w2 = torch.randn(hidden, inputs), torch.randn(hidden, hidden)
    for _ in range(50):
        for head in heads:
            weight = head.detach()
            torch.mm(x, w1.t())
            torch.mm(g1, w2.t())
            outputs = torch.mm(g2, weight.t())
            torch.mm(outputs.t(), g2)
            torch.mm(outputs, weight)
            torch.mm(g2.t(), g1)
            torch.mm(g2, w2)
            torch.mm(g1.t(), x)
    return 50.0 * minibatch


def _device() -> pb.Device:
    return (
        load_games()["shooting_birds"]
        .describe(choose_options(load_games()["shooting_birds"].options, {}, "shooting_birds"))
        .behaviors[0]
        .device
    )


def bench_train(timesteps: int = 1_500_000) -> Figures:
    """Timesteps per second of whole training runs, simulator in its own process."""
    figures: Figures = {}
    for experiment in ("shooting_birds/bucket-11", "beastly_rivals/bucket-3"):
        rates: list[float] = []
        shares: list[dict[str, float]] = []
        config = load_config(CONFIGS / f"{experiment}.yaml", [f"stop_at={timesteps}", "log_interval=150000"])
        with simulator_process() as address, tempfile.TemporaryDirectory() as folder:

            def report(
                done: int,
                live: dict[str, float],
                row: dict[str, float] | None,
                rates: list[float] = rates,
                shares: list[dict[str, float]] = shares,
            ) -> None:
                if row is not None:
                    rates.append(row["timesteps_per_second"])
                    shares.append(row)

            train(config, Path(folder) / "run", [address], resume=False, audience=Audience(report))
        rates = rates[1:]
        figures[f"{experiment}, timesteps/s"] = {
            "median": statistics.median(rates),
            "low": min(rates),
            "high": max(rates),
        }
        for activity in ("simulate", "wire", "act", "learn"):
            share = statistics.median(row[activity] for row in shares[1:])
            figures[f"{experiment}, share of {activity}"] = {"median": share, "low": share, "high": share}
    return figures


def bench_start(timesteps: int = 1_500_000) -> Figures:
    """Seconds that a simulator and a run take to begin; memory of both in MB."""
    figures: Figures = {}
    experiment = CONFIGS / "shooting_birds" / "bucket-11.yaml"

    def seconds(work: Callable[[], object]) -> dict[str, float]:
        times = []
        for _ in range(WINDOWS):
            begin = time.perf_counter()
            work()
            times.append(time.perf_counter() - begin)
        return {"median": statistics.median(times), "low": min(times), "high": max(times)}

    def listen() -> None:
        with simulator_process():
            pass

    def update() -> float:
        """Return when the first row of metrics is there, which the first update is followed by."""
        with tempfile.TemporaryDirectory() as folder:
            command = [sys.executable, "-m", "joybridge", "train", str(experiment), "--run", f"{folder}/run"]
            begin = time.perf_counter()
            silence = subprocess.DEVNULL
            with subprocess.Popen([*command, "log_interval=4425"], stdout=silence, stderr=silence) as process:
                while process.poll() is None and not list(Path(folder).glob("run/metrics-*.csv")):
                    time.sleep(0.01)
                seconds = time.perf_counter() - begin
                if process.poll() is not None:
                    raise RuntimeError(f"{' '.join(command)} ended with exit status {process.returncode}")
                process.terminate()
            return seconds

    updates = [update() for _ in range(WINDOWS)]
    figures["start and end of a simulator, s"] = seconds(listen)
    figures["first update of a run, s"] = {
        "median": statistics.median(updates),
        "low": min(updates),
        "high": max(updates),
    }
    config = load_config(experiment, [f"stop_at={timesteps}", "log_interval=150000"])
    with simulator_process() as address, tempfile.TemporaryDirectory() as folder:
        simulator, *_ = children()
        held: dict[str, list[float]] = {"trainer": [], "simulator": []}

        def report(done: int, live: dict[str, float], row: dict[str, float] | None) -> None:
            if row is not None:
                held["trainer"].append(megabytes(os.getpid()))
                held["simulator"].append(megabytes(simulator))

        train(config, Path(folder) / "run", [address], resume=False, audience=Audience(report))
        with Session(address, "shooting_birds", arenas=256, seed=0) as session:
            acts = random_acts(session.spec, 256, np.random.default_rng(0))
            for step in range(400):
                session.step(acts[step % len(acts)])
            large = megabytes(simulator)
    for name, sizes in held.items():
        key = f"memory of the {name} in training, MB (at the end, at first, at most)"
        figures[key] = {"median": sizes[-1], "low": sizes[0], "high": max(sizes)}
    figures["memory of a simulator at 256 arenas, MB"] = {"median": large, "low": large, "high": large}
    return figures


def children() -> list[int]:
    """Return the children of this process, the newest last."""
    return sorted(int(pid) for pid in Path(f"/proc/self/task/{os.getpid()}/children").read_text().split())


def megabytes(process: int) -> float:
    """Return the resident memory of a process."""
    return int(Path(f"/proc/{process}/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6


def bench_peers() -> Figures:
    """Timesteps per second of others on Shooting Birds bucket-11, and of ours beside them in the same session."""
    from stable_baselines3 import PPO

    from joybridge.gym.sb3 import BridgeVecEnv

    figures = bench_train(450_000)
    ours = figures["shooting_birds/bucket-11, timesteps/s"]["median"]
    figures = {"Joybridge, trained, timesteps/s": figures["shooting_birds/bucket-11, timesteps/s"]}
    for arenas in (15, 75):
        envs = BridgeVecEnv("shooting_birds", arenas, layout="bucket-11")
        model = PPO(  # with the settings of configs/shooting_birds/bucket-11.yaml; the critic has a network of its own
            "MlpPolicy",
            envs,
            seed=0,
            device="cpu",
            n_steps=59,
            batch_size=256,
            n_epochs=4,
            learning_rate=3.25e-4,
            ent_coef=0.05,
            policy_kwargs={"net_arch": [100, 100], "activation_fn": torch.nn.SiLU},
        )
        rates: list[float] = []
        for window in range(4):
            begin = time.perf_counter()
            steps = 59 * arenas * math.ceil(30_000 / (59 * arenas))
            model.learn(steps, reset_num_timesteps=window == 0)
            rates.append(steps / (time.perf_counter() - begin))
        envs.close()
        rates = rates[1:]
        name = f"Stable-Baselines3 PPO, {arenas} arenas"
        median = statistics.median(rates)
        figures[f"{name}, trained, timesteps/s"] = {"median": median, "low": min(rates), "high": max(rates)}
        figures[f"Joybridge / {name}"] = {"median": ours / median, "low": ours / max(rates), "high": ours / min(rates)}
    with simulator_process() as address:
        makers = [partial(BridgeEnv, "shooting_birds", layout="bucket-11", simulator=address) for _ in range(4)]
        vector = AsyncVectorEnv(makers, context="spawn")
        vector.reset(seed=0)

        def work() -> float:
            for _ in range(100):
                vector.step(vector.action_space.sample())
            return 400.0

        figures["Gymnasium AsyncVectorEnv, 4 processes, random actions, agent-steps/s"] = measure(work)
        vector.close()
    return figures


BENCHES = {
    "simulator": bench_simulator,
    "pictures": bench_pictures,
    "wire": bench_wire,
    "learner": bench_learner,
    "train": bench_train,
    "start": bench_start,
    "peers": bench_peers,
}


def machine() -> str:
    """Return what this was measured on."""
    return (
        f"{os.cpu_count()} cores, {platform.machine()}, Python {platform.python_version()}, torch {torch.__version__}"
    )


def main() -> int:
    """Run the command line and return its exit status."""
    parser = argparse.ArgumentParser(description="Measure how fast it is on this machine.")
    parser.add_argument("what", nargs="?", default="all", choices=[*BENCHES, "all"], help="default %(default)s")
    parser.add_argument("--json", action="store_true", help="print one JSON object as the last line of stdout")
    options = parser.parse_args()
    print(machine(), flush=True)
    results = {}
    for name in BENCHES if options.what == "all" else [options.what]:
        print(f"\n{name}", flush=True)
        results[name] = BENCHES[name]()
        for what, figure in results[name].items():
            low, median, high = (
                f"{figure[key]:,.4g}" if figure[key] < 100 else f"{figure[key]:,.0f}"
                for key in ("low", "median", "high")
            )
            print(f"  {what:<64} {median:>12}  ({low} – {high})", flush=True)
    if options.json:
        print(json.dumps({"machine": machine(), "results": results}))
    return 0


if __name__ == "__main__":
    sys.exit(main())
