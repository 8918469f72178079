"""A policy that was exported into a file plays a game: policy.onnx and policy.json alike, by ONNX Runtime."""

from collections.abc import Iterator

import numpy as np

from joybridge.client.client import Session
from joybridge.layouts import make_acts
from joybridge.policy.exported import Exported


def play_file(policy: Exported, session: Session, seed: int) -> Iterator[tuple[float, bool]]:
    """Let an exported policy play the arena of a session; yield the reward of each decision, and whether it was last.

    seed: of the samples. Raises ConfigError if it does what no agent may, and SimulatorError.
    """
    steps = session.steps
    lanes = np.arange(len(steps[policy.behavior].rewards))
    player = policy.seat(len(lanes))
    player.rng = np.random.default_rng(seed)
    player.begin(steps[policy.behavior])
    while True:
        acts = make_acts(session.spec, session.arenas)
        player.act(steps[policy.behavior], acts[policy.behavior], lanes)
        steps = session.step(acts)
        played = steps[policy.behavior]
        player.store(played, lanes)
        yield float(played.rewards.sum()), bool(len(played.ended))
