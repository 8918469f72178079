"""`PointerGame`: what Shooting Birds and Beastly Rivals share: a pointer that moves by an option `locomotion`.

There is one behavior with one agent per arena.
"""

from abc import abstractmethod
from collections.abc import Mapping
from typing import ClassVar

import numpy as np

from joybridge.games.locomotion import LOCOMOTIONS, observe_heading
from joybridge.games.record_game import RecordGame
from joybridge.simulator import Array, StepArrays, quiet_step
from joybridge.v1 import bridge_pb2 as pb


class PointerGame(RecordGame):
    """Many arenas of a game with a pointer. Their records have a field "heading"."""

    sensors: ClassVar[list[pb.Sensor]]  # without that of the locomotion
    channels: ClassVar[list[pb.RewardChannel]]

    def __init__(
        self, options: Mapping[str, str], parameters: Mapping[str, float], arenas: int, first_arena: int, seed: int
    ) -> None:
        """Begin a first episode in every arena."""
        self.locomotion = LOCOMOTIONS[options["locomotion"]]
        self._shapes = [(arenas, *sensor.shape) for sensor in self.sensors]
        super().__init__(options, parameters, arenas, first_arena, seed)

    def observe(self) -> list[StepArrays]:
        """Return the current observations, with zero rewards and no episode ends."""
        return [quiet_step(self.observations(), len(self.channels))]

    def observations(self) -> list[Array]:
        """Return the current observations, float32 [arenas, *shape] per sensor."""
        values = [np.empty(shape, np.float32) for shape in self._shapes]
        self.write_sensors(*values)
        return [*values, observe_heading(self.fields["heading"])] if self.locomotion.sensors else values

    @abstractmethod
    def write_sensors(self, *values: Array) -> None:
        """Write the values of every sensor in `sensors`, float32 [arenas, *shape]."""
