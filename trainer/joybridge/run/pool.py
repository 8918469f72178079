"""Which policies of a run are kept when there is no room for all, and which of them are drawn as opponents."""

from collections.abc import Sequence

import numpy as np

from joybridge.contract.tensors import Array


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
