"""Random numbers for compiled rules: each arena has a stream that depends on the seed and its number only.

NumPy's Philox, a counter-based generator (Salmon et al. 2011), generates uniform numbers in [0, 1) in blocks: block b
of arena a is a pure function of (seed, a, b). The state of a stream is therefore two integers, block and cursor, and
compiled code reads the numbers from plain arrays.
"""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from joybridge.contract.tensors import Array
from joybridge.simulator.batched_game import check_range
from joybridge.simulator.compiled import compiled

BLOCK = 512  # numbers per block


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
