"""Recorded sessions of chance, and a small policy."""

import numpy as np

from joybridge.client.client import Session
from joybridge.config.policy_config import PolicyConfig
from joybridge.layouts import make_acts
from joybridge.layouts.random_acts import obey_masks, press_at_random

SMALL = PolicyConfig(
    frame_stack=2, hidden_sizes=[8], rollout_steps=16, time_horizon=16, minibatch_size=32, learning_rate=3e-3
)


def record(folder, address, game="hybrid", decisions=30, arenas=2, **settings):
    """Record random play and return the file."""
    rng = np.random.default_rng(0)
    with Session(address, game, arenas=arenas, seed=5, **settings) as session:
        demonstration = session.record_demonstration(folder)
        acts = make_acts(session.spec, arenas)
        for _ in range(decisions):
            for part, act, step in zip(session.spec.behaviors, acts, session.steps, strict=True):
                press_at_random(part.device, act, rng)
                obey_masks(act, step, rng)
            session.step(acts)
    return demonstration.path
