"""Training from pictures beside training from numbers, and beside Stable-Baselines3 on the same pictures, in turns.

    python -m tools.bench_sight [--turns N] [KEY=VALUE ...]

The configuration shooting_birds/screen is measured as it is, with two squares and two threads. Beside
Stable-Baselines3, the pictures are the screen of Shooting Birds, 64 x 40 gray pixels, which it sees through
joybridge.gym with its NatureCNN; both learn with the settings of that configuration: arenas, rollouts, minibatches and
epochs, but in one thread, and as KEY=VALUE says.
"""

import argparse
import os
import statistics
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecExtractDictObs

from joybridge.client.launch import simulator_process
from joybridge.config.config import Config, load_config
from joybridge.gym.sb3 import BridgeVecEnv
from joybridge.ppo.threads import in_threads, use_one_thread
from joybridge.run.train import train
from joybridge.run.training import Audience
from tools.bench.measure import CONFIGS, children, machine, megabytes

SCREEN = ["options.observation=screen", "policy.threads=1"]
ROLLOUTS = 8  # of a turn, after the first, in which everything is compiled


def ours(experiment: str, overrides: Sequence[str]) -> tuple[float, float, float]:
    """Train for a turn; return timesteps per second, and the memory of trainer and simulator in MB."""
    config = load_config(CONFIGS / f"{experiment}.yaml", overrides)
    rollout = config.arenas * config.policy.rollout_steps
    ends = [f"log_interval={rollout}", f"stop_at={rollout * (ROLLOUTS + 1)}", "log_to=[]"]
    config = load_config(CONFIGS / f"{experiment}.yaml", [*overrides, *ends])
    rates: list[float] = []

    def report(done: int, live: dict[str, float], row: dict[str, float] | None) -> None:
        if row is not None:
            rates.append(row["timesteps_per_second"])

    with simulator_process() as address, tempfile.TemporaryDirectory() as folder:
        simulator = children()[-1]
        train(config, Path(folder) / "run", [address], resume=False, audience=Audience(report))
        held = megabytes(simulator)
    return statistics.harmonic_mean(rates[1:]), megabytes(os.getpid()), held


def sb3(config: Config) -> PPO:
    """Return their PPO on the same pictures with the same settings."""
    policy = config.policy
    envs = BridgeVecEnv(
        config.game,
        config.arenas,
        layout=config.layout,
        options=config.options,
        flatten=False,
        frame_stack=policy.frame_stack,
    )
    model = PPO(
        "CnnPolicy",
        VecExtractDictObs(envs, "screen"),
        seed=0,
        device="cpu",
        n_steps=policy.rollout_steps,
        batch_size=policy.minibatch_size,
        n_epochs=policy.epochs,
        learning_rate=policy.learning_rate,
        gamma=policy.gamma,
        ent_coef=policy.entropy_coef,
        policy_kwargs={"net_arch": policy.hidden_sizes},
    )
    model.learn(policy.rollout_steps * config.arenas)
    return model


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description="Compare training from pictures with others, in turns.")
    parser.add_argument("--turns", type=int, default=5, help="default %(default)s")
    parser.add_argument("settings", nargs="*", metavar="KEY=VALUE", help="of both that see the screen")
    options = parser.parse_args()
    screen = [*SCREEN, *options.settings]
    print(machine(), flush=True)
    use_one_thread()
    config = load_config(CONFIGS / "shooting_birds/screen.yaml", screen)
    model = sb3(config)
    steps = ROLLOUTS * config.arenas * config.policy.rollout_steps
    rates: dict[str, list[float]] = {"two squares": [], "numbers": [], "screen": [], "Stable-Baselines3": []}
    for _ in range(options.turns):
        rates["two squares"].append(ours("shooting_birds/screen", [])[0])
        rate, trainer, simulator = ours("shooting_birds/screen", screen)
        rates["screen"].append(rate)
        rates["numbers"].append(ours("shooting_birds/bucket-11", [])[0])
        begin = time.perf_counter()
        with in_threads(config.policy.threads):
            model.learn(steps, reset_num_timesteps=False)
        rates["Stable-Baselines3"].append(steps / (time.perf_counter() - begin))
        print(", ".join(f"{name} {each[-1]:,.0f}" for name, each in rates.items()), flush=True)
    for mine, theirs in (("two squares", "numbers"), ("screen", "numbers"), ("screen", "Stable-Baselines3")):
        ratios = [one / other for one, other in zip(rates[mine], rates[theirs], strict=True)]
        print(f"{mine} / {theirs}: {statistics.median(ratios):.2f} ({min(ratios):.2f} to {max(ratios):.2f})")
    print(
        f"memory with the screen: trainer {trainer:.0f} MB, with Stable-Baselines3 in it, simulator {simulator:.0f} MB"
    )


if __name__ == "__main__":
    main()
