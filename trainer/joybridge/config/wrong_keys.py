"""What is wrong with a configuration, in a sentence that says what to write instead."""

import difflib
import re
from collections.abc import Collection, Mapping

from pydantic import ValidationError

from joybridge.config.policy_config import PolicyConfig
from joybridge.contract.text import printable

# How the value of a key is written that holds several values, or values by name.
FORMS = {
    "options": "options.NAME=CHOICE",
    "parameters": "parameters.NAME=VALUE",
    "hand": "hand.KEY=VALUE",
    "games": "games.NAME.KEY=VALUE",
    "memory": "policy.memory.KEY=VALUE",
    "opponents": "opponents.KEY=VALUE",
    "policy": "policy.KEY=VALUE",
    "policies": "policies.NAME.KEY=VALUE",
    "shares": "opponents.shares.NAME=SHARE",
    "reward_weights": "policy.reward_weights.CHANNEL=WEIGHT",
}

MAX_VALUE_CHARS = 200  # characters of a wrong value in an error

# Names of other libraries, and short ones, with the key to use instead.
OTHER_NAMES = {
    "num_envs": "arenas", "n_envs": "arenas", "num_agents": "arenas", "max_steps": "total_timesteps",
    "total_steps": "total_timesteps", "num_timesteps": "total_timesteps", "summary_freq": "log_interval",
    "save_freq": "checkpoint_interval", "checkpoint_freq": "checkpoint_interval", "device": "accelerator",
    "action_space": "layout", "n_steps": "policy.rollout_steps", "num_steps": "policy.rollout_steps",
    "rollout": "policy.rollout_steps", "rollout_length": "policy.rollout_steps", "buffer_size": "policy.rollout_steps",
    "n_stack": "policy.frame_stack", "stacked_vectors": "policy.frame_stack", "hidden_units": "policy.hidden_sizes",
    "net_arch": "policy.hidden_sizes", "batch_size": "policy.minibatch_size",
    "sgd_minibatch_size": "policy.minibatch_size", "n_epochs": "policy.epochs", "num_epoch": "policy.epochs",
    "num_epochs": "policy.epochs", "update_epochs": "policy.epochs", "lr": "policy.learning_rate",
    "ent_coef": "policy.entropy_coef", "beta": "policy.entropy_coef", "clip_coef": "policy.clip_range",
    "epsilon": "policy.clip_range", "clip_eps": "policy.clip_range", "discount": "policy.gamma",
    "lam": "policy.gae_lambda", "lambd": "policy.gae_lambda", "gae": "policy.gae_lambda",
    "reward_signals": "policy.reward_weights", "activation_fn": "policy.activation",
    "lr_schedule": "policy.learning_rate_schedule", "anneal_lr": "policy.learning_rate_schedule",
    "beta_schedule": "policy.entropy_coef_schedule", "epsilon_schedule": "policy.clip_range_schedule",
    "grad_clip": "policy.max_grad_norm", "kl_target": "policy.target_kl", "normalize": "policy.scale_observations",
    "norm_obs": "policy.scale_observations", "norm_reward": "policy.scale_rewards",
    "value_coef": "policy.vf_coef", "vf_loss_coeff": "policy.vf_coef", "clip_range_vf": "policy.clip_vloss",
    "clip_value_loss": "policy.clip_vloss", "norm_adv": "policy.normalize_advantage",
    "orthogonal_init": "policy.ortho_init", "log_std": "policy.log_std_init",
    "adam_epsilon": "policy.adam_eps", "keep": "keep_checkpoints", "stop": "stop_at", "best": "best_metric",
    "groups": "pipeline_groups", "restarts": "max_restarts",
}  # fmt: skip


def wrong_key(error: ValidationError, prefix: str, of_run: Collection[str]) -> str:
    """Return what is wrong. prefix: before the keys that the error names. of_run: the keys of a whole run."""
    first = error.errors()[0]
    key, value = prefix + ".".join(str(part) for part in first["loc"]), first["input"]
    if first["type"] == "extra_forbidden":
        return _unknown(key, value, of_run)
    if first["type"] == "missing":
        return f"{key}: it is missing; every configuration has this key"
    reason = _expected(key, value, first["type"]) or first["msg"].removeprefix("Value error, ")
    if not first["loc"]:  # several keys contradict each other
        return reason
    return f"{key}: got {_show(value)}; {reason}"


def _show(value: object) -> str:
    """Return a value as it was written, cut to a reasonable length."""
    try:
        text = repr(value)
    except ValueError:  # Python refuses to write an integer of more than 4300 digits
        text = "an integer of very many digits"
    return text if len(text) <= MAX_VALUE_CHARS else f"{text[:MAX_VALUE_CHARS]} …"


def _expected(key: str, value: object, problem: str) -> str:
    """Return what a key wants that holds a list, values by name or a parameter; "" for other problems."""
    name = key.rpartition(".")[2]
    if problem == "list_type" and isinstance(value, str | int | float):
        parts = ", ".join(part for part in re.split(r"[\s,;()]+", str(value)) if part)
        return f"expected a list, for example {key}=[{printable(parts)}]"
    if problem == "value_error" and key.startswith("parameters.") and isinstance(value, str):
        return f"expected a number; if it is an option of the game, write options.{name}={value}"
    if problem in ("dict_type", "model_type"):
        form = FORMS.get(name) or FORMS["policies"]
        return f"expected names and values, written {form}"
    return ""


def _unknown(key: str, value: object, of_run: Collection[str]) -> str:
    """Return what is wrong with an unknown key, and what to write instead. of_run: the keys of a whole run."""
    where, _, name = key.rpartition(".")
    if name in OTHER_NAMES:
        return f"unknown key {key!r}; the key is {OTHER_NAMES[name]!r}"
    in_policy = where.startswith("polic")
    keys = {field: f"{where if in_policy else 'policy'}.{field}" for field in PolicyConfig.model_fields}
    keys |= {field: field for field in of_run}
    if near := difflib.get_close_matches(name, keys, n=1):
        outside = f", a key of the whole run, outside `{where}`" if in_policy and near[0] in of_run else ""
        return f"unknown key {key!r}; did you mean {keys[near[0]]!r}{outside}? `joybridge keys` lists all keys"
    if isinstance(value, Mapping) and value:  # "ppo.epochs": only the last part may say what is meant
        inner = next(iter(value))
        return _unknown(f"{key}.{inner}", value[inner], of_run)
    of_game = f"{FORMS['options']} and {FORMS['parameters']}"
    return f"unknown key {key!r}; `joybridge keys` lists all keys; those of the game are written {of_game}"
