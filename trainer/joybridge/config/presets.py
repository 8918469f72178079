"""Presets: the settings of other programs, each under one name, to compare with them.

A preset stands beneath the keys that are written beside it, in the same file or on the same command line, and above
what the file extends. So `preset=sb3` on a command line replaces what a file says.
"""

from collections.abc import Mapping
from typing import Any

HALF_RANGE = 1.0986  # log 3: a deviation of half the range of an axis, which is 1 in the actions of the others

_OTHERS: dict[str, Any] = {
    "frame_stack": 1, "hidden_sizes": [64, 64], "activation": "tanh", "shared_body": False, "ortho_init": True,
    "log_std_init": HALF_RANGE, "scale_observations": "none", "scale_rewards": False, "adam_eps": 1e-5,
    "normalize_advantage": "minibatch", "clip_range": 0.2, "clip_range_schedule": "constant", "entropy": "sum",
    "entropy_coef_schedule": "constant", "max_grad_norm": 0.5, "target_kl": None, "gamma": 0.99, "gae_lambda": 0.95,
}  # fmt: skip

PRESETS: dict[str, dict[str, Any]] = {
    # The defaults of PPO("MlpPolicy") of Stable-Baselines3 2.
    "sb3": {
        "arenas": 1,
        "policy": _OTHERS | {
            "rollout_steps": 2048, "time_horizon": 2048, "minibatch_size": 64, "epochs": 10, "learning_rate": 3e-4,
            "learning_rate_schedule": "constant", "entropy_coef": 0.0, "vf_coef": 0.5, "clip_vloss": False,
        },
    },
    # CleanRL's ppo.py, whose loss of values has another factor of a half.
    "cleanrl": {
        "arenas": 4,
        "policy": _OTHERS | {
            "rollout_steps": 128, "time_horizon": 128, "minibatch_size": 128, "epochs": 4, "learning_rate": 2.5e-4,
            "learning_rate_schedule": "linear", "entropy_coef": 0.01, "vf_coef": 0.25, "clip_vloss": True,
        },
    },
    # The defaults here, which are those of the paper and of ML-Agents 0.7.
    "paper": {
        "arenas": 75,
        "policy": {
            "frame_stack": 3, "hidden_sizes": [100, 100], "activation": "swish", "shared_body": None,
            "ortho_init": False, "log_std_init": 0.0, "scale_observations": "none", "scale_rewards": False,
            "adam_eps": 1e-8, "normalize_advantage": "rollout", "clip_range": 0.2, "clip_range_schedule": "linear",
            "entropy": "mean", "entropy_coef_schedule": "linear", "max_grad_norm": None, "target_kl": None,
            "gamma": 0.99, "gae_lambda": 0.95, "rollout_steps": 59, "time_horizon": 59, "minibatch_size": 256,
            "epochs": 4, "learning_rate": 3.25e-4, "learning_rate_schedule": "linear", "entropy_coef": 0.05,
            "vf_coef": 0.5, "clip_vloss": True,
        },
    },
}  # fmt: skip


def preset_of(data: Mapping[str, Any]) -> dict[str, Any]:
    """Return what the preset sets that keys and values name; nothing if they name none, or one that does not exist."""
    name = data.get("preset")
    return PRESETS.get(name, {}) if isinstance(name, str) else {}
