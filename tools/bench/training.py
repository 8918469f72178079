"""Whole trainings: how fast they are, when they begin to learn, and others beside them."""

import math
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np
import torch
from gymnasium.vector import AsyncVectorEnv

from joybridge.client.client import Session
from joybridge.client.launch import simulator_process
from joybridge.config.config import load_config
from joybridge.gym import BridgeEnv
from joybridge.run.train import train
from joybridge.run.training import Audience
from tools.bench.measure import CONFIGS, WINDOWS, Figures, children, measure, megabytes, random_acts


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
