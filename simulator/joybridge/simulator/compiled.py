"""`compiled`: a decorator that compiles the rules of a game, plain Python functions over arrays, with Numba.

With NUMBA_DISABLE_JIT=1 the same functions run interpreted and give the same bits; a test compares them. Fast-math is
off, because results must be the same on every machine.
"""

import logging
from collections.abc import Callable
from functools import cache
from typing import TypeVar

import numba

F = TypeVar("F", bound=Callable[..., object])


def compiled(function: F) -> F:
    """Return the function, compiled at its first call. Numba caches the machine code on disk where it can.

    It is compiled anew, for seconds, for arrays of another dtype, and for those that are not contiguous or cannot be
    written. A slice of an array of one arena may be contiguous where that of an array of several is not; copy slices.
    """
    try:
        return numba.njit(cache=True, error_model="numpy")(function)  # type: ignore[no-any-return]
    except RuntimeError:  # neither the installation nor the user's cache folder can be written
        _say_that_there_is_no_cache()
        return numba.njit(error_model="numpy")(function)  # type: ignore[no-any-return]


@cache
def _say_that_there_is_no_cache() -> None:
    text = "no folder for compiled rules can be written, so every start compiles them; set NUMBA_CACHE_DIR to one"
    logging.getLogger("simulator").warning(text)
