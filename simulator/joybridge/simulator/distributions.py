"""Parameters that are drawn when an episode begins.

A value is a pure function of (seed, arena, episode, parameter): of NumPy's Philox, counted by the episode, in a part of
the arena's numbers that neither its generator nor its stream (see randomness.py) reaches.
"""

import math
from collections.abc import Mapping, Sequence

import numpy as np

from joybridge.contract.tensors import Array
from joybridge.v1 import bridge_pb2 as pb

DIGITS = 53  # of the chances, which are fractions with so many binary digits


def draw_parameters(
    distributions: Mapping[str, pb.Distribution], parameters: Sequence[pb.Parameter], key: Array, episode: int
) -> dict[str, float]:
    """Return the values in an episode of an arena of those of a game's `parameters` that have a distribution.

    key: uint64 [2], the seed and the number of the arena. episode: how many have begun there since the seed was set.
    """
    if not distributions:
        return {}
    philox = np.random.Philox(key=key, counter=[0, 0, episode, 1])
    chances = np.random.Generator(philox).random(len(parameters)).tolist()
    return {
        parameter.name: _value(distributions[parameter.name], chance)
        for parameter, chance in zip(parameters, chances, strict=True)
        if parameter.name in distributions
    }


def _value(distribution: pb.Distribution, chance: float) -> float:
    """Return the value of a distribution at a chance in [0, 1)."""
    values = distribution.choice.values
    if values:
        return values[int(chance * len(values))]
    if distribution.HasField("uniform"):
        low, high = distribution.uniform.low, distribution.uniform.high
        return min(low + (high - low) * chance, high)
    low, high = distribution.log_uniform.low, distribution.log_uniform.high
    return min(max(low * _power(high / low, chance), low), high)


def _power(base: float, exponent: float) -> float:
    """Return base ** exponent for an exponent in [0, 1), by square roots: unlike powers, they are alike everywhere."""
    result = 1.0
    for _ in range(DIGITS):
        base = math.sqrt(base)
        exponent *= 2.0
        if exponent >= 1.0:
            result *= base
            exponent -= 1.0
    return result
