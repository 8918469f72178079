"""What games have in common that are one environment of Gymnasium or PettingZoo."""

from collections.abc import Mapping
from threading import Lock
from typing import Any, ClassVar

from joybridge.adapters.rendering import close, draw
from joybridge.contract.tensors import Array
from joybridge.simulator import Game
from joybridge.v1 import bridge_pb2 as pb

# Held while an environment is used. Each session plays in a thread of its own, and those that are written with pygame
# draw what they return on its display, of which a process has one: a picture would be that of another arena.
ALONE = Lock()


class EnvironmentGame(Game):
    """One environment. An adapter creates the subclass for each."""

    make: ClassVar[Any]  # returns an environment
    made: ClassVar[pb.GameSpec]

    @classmethod
    def describe(cls, options: Mapping[str, str]) -> pb.GameSpec:
        """Return the spec that was made from the spaces."""
        return cls.made

    def __init__(self) -> None:
        """Make the environment."""
        with ALONE:
            self.env = self.make()

    def draw(self) -> Array:
        """Return what the environment renders."""
        with ALONE:
            return draw(self.env)

    def close(self) -> None:
        """Close the environment."""
        with ALONE:
            close(self.env)
