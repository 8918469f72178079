"""Action spaces of a policy, and sampling from one under a mask."""

from typing import Any, TypeAlias

import numpy as np
from gymnasium.spaces import Box, Dict, MultiDiscrete

from joybridge.contract.tensors import Array
from joybridge.layouts import ActionSpace

ActionSpaces: TypeAlias = "Box | MultiDiscrete | Dict"


def make_action_spaces(space: ActionSpace) -> dict[str, Box | MultiDiscrete]:
    """Return the spaces of the parts of an action: "continuous", "discrete" or both."""
    parts: dict[str, Box | MultiDiscrete] = {}
    if space.continuous:
        parts["continuous"] = Box(-1.0, 1.0, (space.continuous,), np.float32)
    if space.branches:
        parts["discrete"] = MultiDiscrete(space.branches)
    return parts


def sample_allowed(action_space: ActionSpaces, action_mask: Array) -> Any:
    """Return a random action whose choices are all allowed, drawn with the random numbers of `action_space`.

    action_space: of one agent, or of a vector environment. action_mask: "action_mask" of its info, bool [choices] or
    [num_envs, choices].

        actions = sample_allowed(envs.action_space, infos["action_mask"])
    """
    if isinstance(action_space, Dict):
        return {kind: sample_allowed(part, action_mask) for kind, part in action_space.items()}
    if action_space.dtype.kind == "f":
        return action_space.sample()
    # Gymnasium batches a MultiDiscrete as a Box of integers.
    nvec = action_space.nvec if isinstance(action_space, MultiDiscrete) else action_space.high[0] + 1
    lots = np.where(action_mask, action_space.np_random.random(action_mask.shape), -1.0)
    branches = np.split(lots, np.cumsum(nvec)[:-1], axis=-1)
    return np.stack([branch.argmax(axis=-1) for branch in branches], axis=-1).astype(action_space.dtype)
