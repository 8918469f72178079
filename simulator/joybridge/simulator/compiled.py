"""How game rules are compiled: plain Python functions over arrays, made fast by Numba.

The same source runs interpreted with NUMBA_DISABLE_JIT=1, to the same bits (a test compares them), so the
rules are written once. No fast-math: floating point must be the same on every machine.
"""

from collections.abc import Callable
from typing import TypeVar

import numba

F = TypeVar("F", bound=Callable[..., object])


def compiled(function: F) -> F:
    """Compile a function at its first call and keep the machine code in a cache on disk."""
    return numba.njit(cache=True, error_model="numpy")(function)  # type: ignore[no-any-return]
