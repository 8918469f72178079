"""Random numbers for compiled rules: each arena has a stream that depends on the seed and its number only.

NumPy's Philox, a counter-based generator (Salmon et al. 2011), generates uniform numbers in [0, 1) in blocks: block b
of arena a is a pure function of (seed, a, b). The state of a stream is therefore two integers, block and cursor, and
compiled code reads the numbers from plain arrays.
"""

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from joybridge.contract.tensors import Array
from joybridge.simulator.batched_game import check_range
from joybridge.simulator.compiled import compiled
from joybridge.simulator.trigonometry import cosine

BLOCK = 512  # numbers per block
LOG_2 = 0.69314718055994530942
NORMAL_DRAWS = 2  # numbers that one call of `normal` takes


class Streams(NamedTuple):
    """The streams of a batch of arenas, in the form that compiled code accepts."""

    values: Array  # float64 [arenas, BLOCK]: the current block of each
    cursor: Array  # int64 [arenas]: how many numbers of the block are used
    block: Array  # int64 [arenas]: number of the current block
    key: Array  # uint64 [arenas, 2]: seed and arena number


def open_streams(seed: int, first_arena: int, arenas: int) -> Streams:
    """Return the streams of arenas first_arena .. first_arena + arenas - 1 of `seed`, each at its first number."""
    key = np.empty((arenas, 2), np.uint64)
    key[:, 0] = seed
    key[:, 1] = np.arange(first_arena, first_arena + arenas)
    streams = Streams(np.empty((arenas, BLOCK)), np.zeros(arenas, np.int64), np.zeros(arenas, np.int64), key)
    fill(streams, np.arange(arenas))
    return streams


def fill(streams: Streams, arenas: Array) -> None:
    """Generate the current block of the given arenas."""
    for arena in arenas:
        philox = np.random.Philox(key=streams.key[arena], counter=[0, 0, int(streams.block[arena]), 0])
        np.random.Generator(philox).random(out=streams.values[arena])


def reserve(streams: Streams, draws: int) -> None:
    """Guarantee every arena at least `draws` numbers (at most BLOCK): those with fewer left go to their next block."""
    short = np.flatnonzero(streams.cursor > BLOCK - draws)
    if len(short):
        streams.block[short] += 1
        streams.cursor[short] = 0
        fill(streams, short)


def save_streams(streams: Streams) -> dict[str, Array]:
    """Return the state of the streams by name, for a game's `save`."""
    return {"cursor": streams.cursor.copy(), "block": streams.block.copy(), "key": streams.key.copy()}


def restore_streams(streams: Streams, state: Mapping[str, Array]) -> None:
    """Restore the state that `save_streams` returned. Raises ValueError if it is invalid."""
    check_range("cursor", state["cursor"], 0, BLOCK)
    check_range("block", state["block"], 0, 2**62)
    for name in save_streams(streams):
        getattr(streams, name)[:] = state[name]
    fill(streams, np.arange(len(streams.cursor)))


@compiled
def uniform(streams: Streams, arena: int, low: float, high: float) -> float:
    """Return the next number of a stream, uniform in [low, high)."""
    value = streams.values[arena, streams.cursor[arena]]
    streams.cursor[arena] += 1
    return float(low + (high - low) * value)


@compiled
def integer(streams: Streams, arena: int, count: int) -> int:
    """Return the next number of a stream as an integer, uniform in 0 .. count - 1."""
    return int(uniform(streams, arena, 0.0, count))


@compiled
def normal(streams: Streams, arena: int) -> float:
    """Return a standard normal number, from the next two numbers of a stream (Box and Muller 1958)."""
    radius = math.sqrt(-2.0 * _logarithm(1.0 - uniform(streams, arena, 0.0, 1.0)))
    return float(radius * cosine(uniform(streams, arena, 0.0, 2.0 * np.pi)))


@compiled
def _logarithm(x: float) -> float:
    """Return the natural logarithm of x > 0, with the same bits on every machine: see trigonometry.py."""
    fraction, exponent = math.frexp(x)
    if fraction < math.sqrt(0.5):
        fraction, exponent = 2.0 * fraction, exponent - 1
    t = (fraction - 1.0) / (fraction + 1.0)  # within 0.172; log(fraction) = 2 (t + t^3 / 3 + t^5 / 5 ...)
    q, series = t * t, 0.0
    for n in range(21, 0, -2):
        series = 1.0 / n + q * series
    return float(2.0 * t * series + exponent * LOG_2)
