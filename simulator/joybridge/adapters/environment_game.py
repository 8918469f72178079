"""What games have in common that are one environment of Gymnasium or PettingZoo."""

from collections.abc import Mapping
from typing import Any, ClassVar

from joybridge.adapters.display import Display
from joybridge.adapters.rendering import close, draw
from joybridge.contract.tensors import Array
from joybridge.simulator import Game
from joybridge.v1 import bridge_pb2 as pb


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
        self.display = Display()
        with self.display.own():
            self.env = self.make()

    def draw(self) -> Array:
        """Return what the environment renders."""
        with self.display.own():
            return draw(self.env)

    def close(self) -> None:
        """Close the environment."""
        with self.display.own():
            close(self.env)
