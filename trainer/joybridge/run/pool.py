"""Which of a run's policies are kept when there is no room for all: evenly spread over its training."""

from collections.abc import Sequence

import numpy as np


def thinned(timesteps: Sequence[int], limit: int) -> list[int]:
    """Return at most `limit` of some numbers, ascending, the last among them: while too many, the densest one goes."""
    kept = sorted(timesteps)
    while len(kept) > limit:
        inner = [after - before for before, after in zip(kept, kept[2:], strict=False)]  # gaps without what is between
        del kept[1 + int(np.argmin(inner)) if limit > 1 else 0]
    return kept
