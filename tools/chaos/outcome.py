"""What became of the faults of one kind."""

import math
from collections.abc import Sequence
from typing import NamedTuple


class Outcome(NamedTuple):
    """The result of one kind of fault."""

    faults: int
    problems: Sequence[str]  # what was not as it should be, a sentence each
    figures: str  # what was measured, in words


def percentile(values: Sequence[float], share: float) -> float:
    """Return the smallest value that at least this share of the values does not exceed."""
    return sorted(values)[max(0, math.ceil(share * len(values)) - 1)]
