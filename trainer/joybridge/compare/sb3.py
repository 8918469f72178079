"""A configuration trained by PPO of Stable-Baselines3 instead, on the same environment of Gymnasium.

python -m joybridge.compare.sb3 CONFIG --run RUN [--ppo JSON] [--environment MODULE:ID] [KEY=VALUE ...]

The folder of the run gets the same file of metrics as one of our runs, and the model.
"""

import argparse
import json
import math
import re
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from statistics import mean, pstdev
from typing import Any

from gymnasium import spaces
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.env_util import make_vec_env
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.vec_env import VecEnv, VecNormalize
from torch import nn
from torch.optim import AdamW

from joybridge.client.run_command import run_command
from joybridge.compare.environments import is_registered
from joybridge.config.config import Config, HandConfig, dump_config, load_config
from joybridge.config.errors import ConfigError
from joybridge.config.files import write_atomically
from joybridge.config.metrics import HELD_OUT, Cells, Row, cells_of, write_cells
from joybridge.config.overrides import add_overrides, parse_overrides
from joybridge.ppo.schedule import anneal
from joybridge.ppo.threads import use_one_thread
from joybridge.run.origin import keep_origin
from joybridge.run.sources import note_sources

FINISHED = "config.yaml"  # in the folder of a run, when all is done
ACTIVATIONS = {"tanh": nn.Tanh, "relu": nn.ReLU, "elu": nn.ELU, "swish": nn.SiLU}
# Of the evaluation, times the number of the seed: the games are neither those of the training nor those of another run,
# since environment i of a run gets its seed + i.
OTHER_SEED = 10_000


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit status."""
    parser = argparse.ArgumentParser(prog="python -m joybridge.compare.sb3")
    parser.add_argument("config", type=Path)
    parser.add_argument("--run", type=Path, required=True)
    parser.add_argument("--ppo", type=json.loads, default={}, metavar="JSON", help="further arguments of PPO")
    parser.add_argument("--environment", metavar="[MODULE:]ID", help="of Gymnasium; default: the configuration's game")
    add_overrides(parser, "e.g. seed=3")
    return run_command(train, parse_overrides(parser, arguments))


def train(options: argparse.Namespace) -> None:
    """Train a configuration; the folder holds a file of metrics, the model and, when all is done, the configuration.

    Raises ConfigError and StorageError.
    """
    use_one_thread()
    config = load_config(options.config, options.overrides)
    run, policy = options.run, config.policy
    (run / FINISHED).unlink(missing_ok=True)
    keep_origin(run)
    environment = options.environment or config.game
    note_sources(run, [f"gym:{environment}"], config)
    env = _environments(environment, config.arenas, config.seed)
    if policy.scale_observations == "running" or policy.scale_rewards:
        env = VecNormalize(
            env, norm_obs=policy.scale_observations == "running", norm_reward=policy.scale_rewards, gamma=policy.gamma
        )
    model = PPO("MlpPolicy", env, **arguments_of(config, env) | options.ppo)
    metrics = Metrics(run / "metrics-agent.csv", config.log_interval)
    model.learn(config.end, callback=metrics)
    model.save(run / "model.zip")
    if config.evaluate_during:
        episodes = config.evaluate_during.episodes
        others = _environments(environment, min(episodes, 16), OTHER_SEED * (config.seed + 1) % 2**32)
        metrics.finish(evaluate(model, others, episodes))
    write_atomically(run / FINISHED, dump_config(config).encode())


def check_config(config: Config) -> None:
    """Raise ConfigError for what a configuration says and no argument of PPO means."""
    policy = config.policy
    if config.layout != "hybrid" and not re.fullmatch("gsde-[0-9]+", config.layout):
        raise ConfigError(
            f"PPO of Stable-Baselines3 acts in the spaces of the environment, as the layouts hybrid and gsde-N do, not "
            f"as {config.layout}; compare layouts without --beside"
        )
    fits = {
        "policies": not config.policies,
        "curriculum": not config.curriculum,
        "hand": config.hand == HandConfig(),
        "pointer": config.pointer != "velocity",
        "demonstrations": config.demonstrations is None,
        "weights_from": config.weights_from is None,
        "sensors": policy.sensors is None,
        "reward_weights": not policy.reward_weights,
        "penalty_ramp": not policy.penalty_ramp,
        "remember_acts": not policy.remember_acts,
        "frame_stack": policy.frame_stack == 1,
        "time_horizon": policy.time_horizon >= policy.rollout_steps,
        "memory": policy.memory.kind == "none",
        "network": policy.network is None,
        "loss": policy.loss is None,
        "shared_body": policy.shared_body is False,
        "scale_observations": policy.scale_observations != "bounds",
        "normalize_advantage": policy.normalize_advantage != "rollout",
        "clip_vloss": not policy.clip_vloss,
        "log_std_init": isinstance(policy.log_std_init, float),
        "entropy_coef_schedule": policy.entropy_coef_schedule == "constant" or not policy.entropy_coef,
    }
    if others := [key for key, fit in fits.items() if not fit]:
        raise ConfigError(
            f"PPO of Stable-Baselines3 cannot be set to this {', '.join(others)}; begin with preset=sb3, its defaults"
        )


def arguments_of(config: Config, env: VecEnv) -> dict[str, Any]:
    """Return the arguments of PPO that mean what a configuration says. Raises ConfigError for what has no argument."""
    check_config(config)
    policy = config.policy
    kwargs: dict[str, Any] = {
        "net_arch": policy.hidden_sizes,
        "activation_fn": ACTIVATIONS[policy.activation],
        "ortho_init": policy.ortho_init,
        "optimizer_kwargs": {"eps": policy.adam_eps},
    }
    if policy.weight_decay:
        kwargs |= {
            "optimizer_class": AdamW,
            "optimizer_kwargs": {"eps": policy.adam_eps, "weight_decay": policy.weight_decay},
        }
    entropy_coef = policy.entropy_coef
    if isinstance(env.action_space, spaces.Box):
        assert isinstance(policy.log_std_init, float)
        half = float((env.action_space.high - env.action_space.low).max()) / 2
        kwargs["log_std_init"] = policy.log_std_init + math.log(half / 3)  # there in units of the action
        if policy.entropy == "mean":  # there it is always the sum over axes
            entropy_coef /= math.prod(env.action_space.shape)
    hold = config.layout.partition("gsde-")[2]
    return {
        "use_sde": hold != "",
        "sde_sample_freq": int(hold or -1),
        "n_steps": policy.rollout_steps,
        "batch_size": policy.minibatch_size,
        "n_epochs": policy.epochs,
        "learning_rate": _schedule(config, "learning_rate"),
        "clip_range": _schedule(config, "clip_range"),
        "ent_coef": entropy_coef,
        "vf_coef": policy.vf_coef,
        "gamma": policy.gamma,
        "gae_lambda": policy.gae_lambda,
        "max_grad_norm": math.inf if policy.max_grad_norm is None else policy.max_grad_norm,
        "normalize_advantage": policy.normalize_advantage == "minibatch",
        "target_kl": policy.target_kl,
        "policy_kwargs": kwargs,
        "seed": config.seed,
        "device": "cpu",
    }


def evaluate(model: PPO, env: VecEnv, episodes: int) -> Row:
    """Return the columns of so many episodes with the most probable actions, under the moments of the training."""
    trained = model.get_vec_normalize_env()
    if trained is not None:
        env = VecNormalize(env, training=False, norm_obs=trained.norm_obs, norm_reward=False)
        if trained.norm_obs:
            env.obs_rms = trained.obs_rms
    rewards, lengths = evaluate_policy(model, env, episodes, deterministic=True, return_episode_rewards=True)
    assert isinstance(rewards, list) and isinstance(lengths, list)
    return {
        f"{HELD_OUT}{name}": float(value)
        for name, value in _summary([*zip(rewards, map(float, lengths), strict=True)]).items()
    }


class Metrics(BaseCallback):
    """Writes a row of metrics every `interval` timesteps, as our trainer does."""

    def __init__(self, path: Path, interval: int) -> None:
        """Begin a file of metrics."""
        super().__init__()
        self._path, self._interval = path, interval
        self._rows: list[Cells] = []
        self._episodes: list[tuple[float, float]] = []  # reward and length of those since the last row
        self._begin = time.monotonic()

    def finish(self, columns: Row) -> None:
        """Add columns to the last row."""
        if self._rows:
            self._rows[-1] |= cells_of(columns)
            write_cells(self._path, self._rows)

    def _on_step(self) -> bool:
        ended = (info["episode"] for info in self.locals["infos"] if "episode" in info)
        self._episodes += [(episode["r"], float(episode["l"])) for episode in ended]
        before = self.num_timesteps - self.training_env.num_envs
        if before // self._interval < self.num_timesteps // self._interval:
            row = {"timesteps": self.num_timesteps, "seconds": time.monotonic() - self._begin}
            self._rows.append(cells_of(row | _summary(self._episodes)))
            write_cells(self._path, self._rows)
            self._episodes = []
        return True


def _summary(episodes: Sequence[tuple[float, float]]) -> Row:
    """Return the columns of episodes, each with its reward and its length."""
    if not episodes:
        return {"episodes": 0}
    rewards, lengths = zip(*episodes, strict=True)
    return {"episodes": len(rewards), "reward": mean(rewards), "reward_std": pstdev(rewards), "length": mean(lengths)}


def _schedule(config: Config, name: str) -> float | Callable[[float], float]:
    """Return a coefficient: a number if it is constant, or what gives its value here for the share that is left.

    That is the share of what is trained, which `stop_at` may end before the schedules end.
    """
    policy, trained = config.policy, config.end / config.total_timesteps
    if getattr(policy, f"{name}_schedule") == "constant":
        return float(getattr(policy, name))
    return lambda left: float(getattr(anneal(trained * (1.0 - left), policy), name))


def _environments(environment: str, number: int, seed: int) -> VecEnv:
    """Return environments of Gymnasium, one after the other in this process. Raises ConfigError for another game."""
    if not is_registered(environment):
        raise ConfigError(f"Stable-Baselines3 trains environments of Gymnasium here; there is no {environment!r}")
    return make_vec_env(environment, number, seed=seed)


if __name__ == "__main__":
    raise SystemExit(main())
