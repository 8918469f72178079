"""Generalized advantage estimation (Schulman et al. 2016), aware of both kinds of ends and of skipped steps."""

import numpy as np

from joybridge.contract.tensors import Array


def gae(
    rewards: Array,
    values: Array,
    last_values: Array,
    terminated: Array,
    truncated: Array,
    final_values: Array,
    deciding: Array,
    *,
    gamma: float,
    gae_lambda: float,
    time_horizon: int,
) -> Array:
    """Return the advantages, float32 [steps, lanes].

    rewards, values, terminated, truncated, deciding [steps, lanes]: of the transition that begins with the
    lane's decision in that step. Where `deciding` is false no transition begins; its row is 0 and skipped.
    last_values [lanes]: the value of what follows the last step.
    final_values [steps, lanes]: at a truncation, the value of the episode's last observation.
    time_horizon: after every so many steps the sum is cut and continued by the value alone, as the original
    cuts its trajectories.
    """
    advantages = np.zeros_like(rewards)
    next_value = last_values.copy()
    next_advantage = np.zeros_like(last_values)
    for step in reversed(range(len(rewards))):
        if (step + 1) % time_horizon == 0:
            next_advantage[:] = 0.0
        goes_on = ~(terminated[step] | truncated[step])
        future = np.where(goes_on, next_value, np.where(truncated[step], final_values[step], 0.0))
        delta = rewards[step] + gamma * future - values[step]
        advantage = delta + gamma * gae_lambda * next_advantage * goes_on
        live = deciding[step]
        advantages[step] = np.where(live, advantage, 0.0)
        next_value = np.where(live, values[step], next_value)
        next_advantage = np.where(live, advantage, next_advantage)
    return advantages
