"""`compiled`: a decorator that compiles the rules of a game, plain Python functions over arrays, with Numba.

With NUMBA_DISABLE_JIT=1 the same functions run interpreted and give the same bits; a test compares them. Fast-math is
off, because results must be the same on every machine.
"""

from collections.abc import Callable
from typing import TypeVar

import numba

F = TypeVar("F", bound=Callable[..., object])


def compiled(function: F) -> F:
    """Return the function, compiled at its first call. Numba caches the machine code on disk."""
    return numba.njit(cache=True, error_model="numpy")(function)  # type: ignore[no-any-return]
