"""`compiled`: a decorator that compiles the rules of a game, plain Python functions over arrays, with Numba.

With NUMBA_DISABLE_JIT=1 the same functions run interpreted and give the same bits; a test compares them. Fast-math is
off, because results must be the same on every machine.

Numba is imported at the first call: it takes half a second, which a server that plays other games need not wait for.
"""

import logging
from collections.abc import Callable
from functools import cache, update_wrapper
from importlib.util import find_spec
from threading import Lock
from typing import Any, TypeVar, cast

from joybridge.contract.machine_code import delete_stale

F = TypeVar("F", bound=Callable[..., object])

if find_spec("numba") is None:
    raise ModuleNotFoundError("No module named 'numba'", name="numba")

_waiting: "list[_Compiled]" = []
_preparing = Lock()  # sessions play in threads


class _Compiled:
    """A function that is compiled at its first call, together with all others, which it may call."""

    def __init__(self, function: Callable[..., object]) -> None:
        self.function, self.dispatcher = function, cast(Any, None)
        update_wrapper(self, function)
        _waiting.append(self)

    def __call__(self, *arguments: Any) -> Any:
        if self.dispatcher is None:
            _prepare()
        return self.dispatcher(*arguments)


def compiled(function: F) -> F:
    """Return the function, compiled at its first call. Numba caches the machine code on disk where it can.

    It is compiled again, for seconds, for arrays of another dtype, and for those that are not contiguous or cannot be
    written. A slice of an array of one arena may be contiguous where that of an array of several is not; copy slices.
    """
    return cast(F, _Compiled(function))


def _prepare() -> None:
    """Give Numba all functions, and put what it returns in their places: compiled code can call nothing else."""
    with _preparing:
        made = [(each, _dispatcher(each.function)) for each in _waiting]
        dispatchers = {id(each): dispatcher for each, dispatcher in made}
        for each, _ in made:
            names = each.function.__globals__
            found = [(name, value) for name, value in names.items() if isinstance(value, _Compiled)]
            names |= {name: value.dispatcher or dispatchers.get(id(value), value) for name, value in found}
        for each, dispatcher in made:  # from here on, other threads call them
            each.dispatcher = dispatcher
        del _waiting[: len(made)]


def _dispatcher(function: Callable[..., object]) -> Any:
    import numba

    delete_stale(function.__code__.co_filename)
    try:
        return numba.njit(cache=True, error_model="numpy")(function)
    except RuntimeError:  # neither the installation nor the user's cache folder can be written
        _say_that_there_is_no_cache()
        return numba.njit(error_model="numpy")(function)


@cache
def _say_that_there_is_no_cache() -> None:
    text = "no folder for compiled rules can be written, so every start compiles them; set NUMBA_CACHE_DIR to one"
    logging.getLogger("simulator").warning(text)
