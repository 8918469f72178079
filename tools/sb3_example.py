"""Train Shooting Birds with PPO of Stable-Baselines3, through the Gymnasium environments.

python -m tools.sb3_example --timesteps 200000 --arenas 15
"""

import argparse
import time
from typing import Any

import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecEnv
from stable_baselines3.common.vec_env.base_vec_env import VecEnvIndices, VecEnvStepReturn

from joybridge.contract.tensors import Array
from joybridge.gym import BridgeVectorEnv

LOG_INTERVAL = 20_000  # timesteps between two lines


class BridgeVecEnv(VecEnv):
    """A BridgeVectorEnv as a VecEnv of Stable-Baselines3; both begin the next episode in the step that ends one."""

    def __init__(self, envs: BridgeVectorEnv) -> None:
        """Wrap environments; closing this closes them."""
        self.envs = envs
        super().__init__(envs.num_envs, envs.single_observation_space, envs.single_action_space)

    def reset(self) -> Array:
        """Begin new episodes; of the seeds that were set, the first one is used for all arenas."""
        observations, _ = self.envs.reset(seed=self._seeds[0])
        self._reset_seeds()
        return observations

    def step_async(self, actions: Array) -> None:
        """Keep the actions for `step_wait`."""
        self.actions = actions

    def step_wait(self) -> VecEnvStepReturn:
        """Advance every arena by one decision."""
        observations, rewards, terminated, truncated, infos = self.envs.step(self.actions)
        ended = terminated | truncated
        each: list[dict[str, Any]] = [{} for _ in ended]
        for lane in np.flatnonzero(ended):
            each[lane]["terminal_observation"] = infos["final_obs"][lane]
            each[lane]["TimeLimit.truncated"] = bool(truncated[lane])  # PPO then bootstraps from the value
        return observations, rewards.astype(np.float32), ended, each

    def close(self) -> None:
        """Close the environments."""
        self.envs.close()

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        """Return an attribute, once per lane."""
        return [getattr(self.envs, attr_name) for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: VecEnvIndices = None) -> None:
        """Raise NotImplementedError: single lanes have no attributes."""
        raise NotImplementedError

    def env_method(
        self, method_name: str, *arguments: Any, indices: VecEnvIndices = None, **settings: Any
    ) -> list[Any]:
        """Raise NotImplementedError: single lanes have no methods."""
        raise NotImplementedError

    def env_is_wrapped(self, wrapper_class: Any, indices: VecEnvIndices = None) -> list[bool]:
        """Return False for each lane."""
        return [False for _ in self._get_indices(indices)]


class RewardLog(BaseCallback):
    """Prints the mean reward of the last timesteps and the speed so far."""

    def __init__(self, episode: int) -> None:
        """Print rewards per `episode` decisions."""
        super().__init__()
        self.episode, self.rewards, self.logged = episode, 0.0, 0

    def _on_training_start(self) -> None:
        self.begin = time.perf_counter()

    def _on_step(self) -> bool:
        self.rewards += float(self.locals["rewards"].sum())
        if self.num_timesteps - self.logged >= LOG_INTERVAL:
            reward = self.rewards / (self.num_timesteps - self.logged) * self.episode
            speed = self.num_timesteps / (time.perf_counter() - self.begin)
            print(f"{self.num_timesteps:>10,} timesteps  reward {reward:8.1f}  {speed:7,.0f} timesteps/s", flush=True)
            self.rewards, self.logged = 0.0, self.num_timesteps
        return True


def make_model(envs: BridgeVectorEnv, seed: int) -> PPO:
    """Return PPO with the settings of configs/shooting_birds/bucket-11.yaml; the critic has a network of its own."""
    return PPO(
        "MlpPolicy", BridgeVecEnv(envs), seed=seed, device="cpu",
        n_steps=59, batch_size=256, n_epochs=4, learning_rate=3.25e-4, ent_coef=0.05,
        policy_kwargs={"net_arch": [100, 100], "activation_fn": torch.nn.SiLU},
    )  # fmt: skip


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description="Train Shooting Birds with Stable-Baselines3's PPO.")
    parser.add_argument("--timesteps", type=int, default=200_000, help="length of the run; default %(default)s")
    parser.add_argument("--arenas", type=int, default=15, help="default %(default)s")
    parser.add_argument(
        "--layout",
        default="bucket-11",
        help="bucket-N or threshold-T; default %(default)s",
    )
    parser.add_argument("--seed", type=int, default=0, help="of game and learner; default %(default)s")
    options = parser.parse_args()
    torch.set_num_threads(1)  # networks this small are slower with more
    envs = BridgeVectorEnv("shooting_birds", options.arenas, layout=options.layout)
    model = make_model(envs, options.seed)
    print(f"rewards are per episode of {envs.game_spec.max_episode_decisions} decisions")
    model.learn(options.timesteps, RewardLog(envs.game_spec.max_episode_decisions))
    envs.close()


if __name__ == "__main__":
    main()
