"""What the service runs: a game over many arenas at once, one call per decision for all of them.

The built-in games implement `BatchedGame` directly, for speed. An author of a new game starts from the
one-arena `Game` in `game.py`, which `arenas.py` makes into a BatchedGame.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from joybridge.contract.codec import ActArrays, StepArrays
from joybridge.contract.tensors import Array
from joybridge.v1 import bridge_pb2 as pb


class GameError(Exception):
    """A failure inside a game that the game can place; its text names the arena where that is known."""


class BatchedGame(ABC):
    """Many arenas of one game. The service checks every input; a game may trust what it is given.

    Arena i of a session plays arena `first_arena + i` of the seed: its randomness depends on the seed
    and that number alone, never on how many arenas there are.
    """

    name: ClassVar[str]
    description: ClassVar[str]

    @classmethod
    @abstractmethod
    def options(cls) -> list[pb.Option]:
        """Return the game's options."""

    @classmethod
    @abstractmethod
    def describe(cls, options: Mapping[str, str]) -> pb.GameSpec:
        """Return the spec under the given choice of every option."""

    @abstractmethod
    def __init__(
        self, options: Mapping[str, str], parameters: Mapping[str, float], arenas: int, first_arena: int, seed: int
    ) -> None:
        """Begin a first episode in every arena. `parameters` holds only those that differ from their defaults."""

    @abstractmethod
    def reset(self, seed: int | None, parameters: Mapping[str, float]) -> None:
        """Begin new episodes everywhere; with a seed, as a new session with that seed would."""

    @abstractmethod
    def observe(self) -> list[StepArrays]:
        """Return the present observations, with zero rewards and no ends, one per behavior."""

    @abstractmethod
    def step(self, acts: list[ActArrays]) -> list[StepArrays]:
        """Advance every arena by one decision, one ActArrays and one StepArrays per behavior."""

    def draw(self, arena: int) -> Array:
        """Return a picture of one arena, uint8 [height, width, 3]; needed where the spec has a picture size."""
        raise NotImplementedError(f"{self.name} has a picture size in its spec but does not draw")

    def save(self) -> dict[str, Array]:
        """Return the whole state by name; needed where the spec allows snapshots."""
        raise NotImplementedError(f"{self.name} allows snapshots in its spec but does not save")

    def restore(self, state: Mapping[str, Array]) -> None:
        """Take back the state that `save` returned; its names, dtypes and shapes have been checked."""
        raise NotImplementedError(f"{self.name} allows snapshots in its spec but does not restore")


def quiet_step(observations: list[Array], channels: int) -> StepArrays:
    """Return a step in which nothing was earned and nothing ended."""
    lanes = len(observations[0])
    zeros = np.zeros(lanes, bool)
    return StepArrays(observations, np.zeros((lanes, channels), np.float32), zeros, zeros.copy())


def check_range(what: str, values: Array, low: float, high: float) -> None:
    """Raise ValueError unless all values lie in low..high (NaN does not): a restored state may be anybody's."""
    if not ((values >= low) & (values <= high)).all():
        raise ValueError(f"{what} is outside {low:g}..{high:g}")
