"""A batched game under random actions, and the digest of what its arenas observe and earn."""

import hashlib
from typing import Any

import numpy as np

from joybridge.contract.codec import ActArrays
from joybridge.v1 import bridge_pb2 as pb


def step(game: Any, axes: tuple[float, ...] = (0.0, 0.0), choices: tuple[int, ...] = (0, 0)) -> Any:
    """Take the same action in every arena; return the step of the first behavior."""
    lanes = len(game.arenas)
    act = ActArrays(np.tile(np.array(axes, np.float32), (lanes, 1)), np.tile(np.array(choices, np.int32), (lanes, 1)))
    return game.step([act])[0]


def sweep(game: Any, decisions: int, device: pb.Device | None = None) -> list[str]:
    """Play random actions, the same in every arena; return the digest of each.

    device: what is drawn for; default: two axes and two buttons.
    """
    random = np.random.default_rng(3)
    axes, branches = (len(device.axes), len(device.branches)) if device else (2, 2)
    digests = [hashlib.sha256() for _ in game.arenas]
    for _ in range(decisions):
        seen = step(game, tuple(random.uniform(-1.0, 1.0, axes)), tuple(random.integers(0, 2, branches)))
        for values in (*seen.observations, seen.rewards):
            for digest, row in zip(digests, values, strict=True):
                digest.update(row.tobytes())
    return [digest.hexdigest() for digest in digests]
