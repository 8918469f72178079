"""Generated levels: the option `levels`, and which level an episode plays.

A level is a number from which a game makes it, and nothing else. The numbers are divided once and for all into three
sets, to train on, to test on, and to test on once, after everything else has been decided. The parameters `first_level`
and `level_count` choose the levels that are played; they never leave the set of the first one.
"""

import numpy as np

from joybridge.contract.tensors import Array
from joybridge.simulator import option, parameter
from joybridge.simulator.compiled import compiled
from joybridge.simulator.randomness import Streams, fill, integer, open_streams

SET_SIZE = 1_000_000
SETS = {name: range(k * SET_SIZE, (k + 1) * SET_SIZE) for k, name in enumerate(("training", "test", "reserved"))}
LEVEL_SEED = 0x4C4556454C  # of the streams that levels are made from, one per number

LEVELS_OPTION = option(
    "levels",
    ["original", "generated"],
    description="original: those of the paper's game; generated: in each episode one that is made from a number, which "
    "the parameters first_level and level_count choose",
)
PARAMETERS = [
    parameter("first_level", 0.0, len(SETS) * SET_SIZE - 1.0, 0.0, "number of the first generated level"),
    parameter("level_count", 1.0, SET_SIZE, SET_SIZE, "how many generated levels there are to play"),
]


@compiled
def draw_level(arena, streams, i):
    """Return the number of the generated level that an episode of arena i plays."""
    first, drawn = int(arena.first_level), integer(streams, i, int(arena.level_count))
    start = first // SET_SIZE * SET_SIZE
    return start + (first - start + drawn) % SET_SIZE


def open_level_streams(numbers: Array) -> Streams:
    """Return the random numbers that levels are made from, a stream each: they depend on the level's number alone."""
    streams = open_streams(LEVEL_SEED, 0, len(numbers))
    streams.key[:, 1] = numbers
    fill(streams, np.arange(len(numbers)))
    return streams
