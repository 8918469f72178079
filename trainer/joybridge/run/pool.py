"""Which policies of a run are kept when there is no room for all, and which of them are drawn as opponents."""

from collections.abc import Sequence

import numpy as np

from joybridge.config.arrays import select
from joybridge.contract.tensors import Array
from joybridge.policy.actor import Actor
from joybridge.policy.table import Guest

LEAGUE = "league/"  # begins the names of the arrays of a checkpoint that are about opponents


def thinned(timesteps: Sequence[int], limit: int) -> list[int]:
    """Return at most `limit` of some numbers, ascending, the last among them: while too many, the densest one goes."""
    kept = sorted(timesteps)
    while len(kept) > limit:
        inner = [after - before for before, after in zip(kept, kept[2:], strict=False)]  # gaps without what is between
        del kept[1 + int(np.argmin(inner)) if limit > 1 else 0]
    return kept


def sampling_weights(ahead: Sequence[float], sampling: str) -> Array:
    """Return how likely each policy of a pool is drawn, oldest first; the sum is 1.

    ahead: the share of meetings in which the learner was ahead of each. Prioritized fictitious self-play is from
    Vinyals et al., "Grandmaster level in StarCraft II using multi-agent reinforcement learning".
    """
    p = np.array(ahead)
    weights = np.ones(len(p))
    if sampling == "latest":
        weights[:-1] = 0.0
    elif sampling == "pfsp_hard":
        weights = (1 - p) ** 2
    elif sampling == "pfsp_even":
        weights = p * (1 - p)
    shares: Array = weights / weights.sum()
    return shares


def pooled(arrays: dict[str, Array]) -> dict[int, int]:
    """Return the timesteps of the past policies in the arrays of a checkpoint, by their number, oldest first."""
    pool = arrays.get(f"{LEAGUE}pool")
    return {} if pool is None else dict(pool.tolist())


def load_pooled(actors: Sequence[Actor | Guest], arrays: dict[str, Array], number: int) -> None:
    """Let actors be an opponent in the arrays of a checkpoint. Raises CheckpointError where it does not fit."""
    for actor in actors:
        actor.load(select(arrays, f"{LEAGUE}policies.{number}.{actor.name}."))
