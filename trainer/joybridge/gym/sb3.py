"""Games as a VecEnv of Stable-Baselines3, with masks for MaskablePPO of sb3-contrib.

    from joybridge.gym.sb3 import BridgeVecEnv
    from sb3_contrib import MaskablePPO

    envs = BridgeVecEnv("archer", arenas=32, layout="bucket-5", frame_stack=1)
    MaskablePPO("MlpPolicy", envs, n_steps=60, batch_size=256).learn(200_000)

PPO of Stable-Baselines3 itself knows no masks: pass `forbidden="first_allowed"` if the game has them.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.spaces import Dict

from joybridge.client.own_games import Game
from joybridge.config.errors import ConfigError
from joybridge.contract.tensors import Array
from joybridge.gym.vector_env import BridgeVectorEnv

try:
    from stable_baselines3.common.vec_env import VecEnv
    from stable_baselines3.common.vec_env.base_vec_env import VecEnvIndices, VecEnvStepReturn
except ModuleNotFoundError as error:
    raise ModuleNotFoundError(
        f"joybridge.gym.sb3 needs the module {error.name}; install it with `pip install stable-baselines3`",
        name=error.name,
    ) from error

__all__ = ["BridgeVecEnv"]


class BridgeVecEnv(VecEnv):
    """Many arenas of a game. When an episode ends, the next one begins in the same step.

    The info of an episode's last step holds its metrics by name, besides what Stable-Baselines3 asks for.
    """

    _mask: Array | None = None

    def __init__(self, game: Game, arenas: int = 75, **settings: Any) -> None:
        """Make a BridgeVectorEnv with these arguments; closing this closes it.

        Raises its errors, and ConfigError for a layout with a Dict as action space, which Stable-Baselines3 lacks.
        """
        self.envs = BridgeVectorEnv(game, arenas, **settings)
        if isinstance(self.envs.single_action_space, Dict):
            self.envs.close()
            raise ConfigError(
                "Stable-Baselines3 has no actions that are continuous and discrete at once; choose a layout with one "
                "kind, such as layout='bucket-5' or layout='threshold-0.0'"
            )
        super().__init__(self.envs.num_envs, self.envs.single_observation_space, self.envs.single_action_space)

    def action_masks(self) -> Array:
        """Return which choices are allowed in the next step, bool [num_envs, choices], one branch after the other.

        Raises ResetNeeded before the first reset.
        """
        if self._mask is None:
            raise ResetNeeded("no episode is being played; call reset first")
        return self._mask

    def reset(self) -> Any:
        """Begin new episodes; of the seeds and options that were set, the first ones are used for all arenas."""
        observations, infos = self.envs.reset(seed=self._seeds[0], options=self._options[0] or None)
        self._mask = infos["action_mask"]
        self._reset_seeds()
        self._reset_options()
        return observations

    def step_async(self, actions: Array) -> None:
        """Keep the actions for `step_wait`."""
        self._actions = actions

    def step_wait(self) -> VecEnvStepReturn:
        """Play one decision in every arena."""
        observations, rewards, terminated, truncated, infos = self.envs.step(self._actions)
        self._mask = infos["action_mask"]
        ended = terminated | truncated
        each: list[dict[str, Any]] = [{} for _ in ended]
        for lane in np.flatnonzero(ended):
            metrics = infos["final_info"]
            each[lane] = {name: float(metrics[name][lane]) for name in metrics if f"_{name}" in metrics}
            each[lane]["terminal_observation"] = infos["final_obs"][lane]
            each[lane]["TimeLimit.truncated"] = bool(truncated[lane])  # PPO then bootstraps from the value
        return observations, rewards.astype(np.float32), ended, each

    def get_images(self) -> Sequence[Array | None]:
        """Return the arenas' pictures, as BridgeVectorEnv.render does."""
        return self.envs.render() or [None] * self.num_envs

    def close(self) -> None:
        """Close the environments."""
        self.envs.close()

    def get_attr(self, attr_name: str, indices: VecEnvIndices = None) -> list[Any]:
        """Return an attribute of this object or of the BridgeVectorEnv, once per lane. Raises AttributeError."""
        owner = self if hasattr(type(self), attr_name) else self.envs
        return [getattr(owner, attr_name) for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: VecEnvIndices = None) -> None:
        """Raise NotImplementedError: single lanes have no attributes."""
        raise NotImplementedError

    def env_method(
        self, method_name: str, *arguments: Any, indices: VecEnvIndices = None, **settings: Any
    ) -> list[Any]:
        """Return each lane's row of `action_masks`. Raises NotImplementedError for other methods: lanes have none."""
        if method_name != "action_masks":
            raise NotImplementedError(f"single lanes have no method {method_name!r}, expected 'action_masks'")
        masks = self.action_masks()
        return [masks[lane] for lane in self._get_indices(indices)]

    def env_is_wrapped(self, wrapper_class: Any, indices: VecEnvIndices = None) -> list[bool]:
        """Return False for each lane."""
        return [False for _ in self._get_indices(indices)]
