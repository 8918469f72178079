"""`PointerGame`: what Shooting Birds and Beastly Rivals share: a pointer, and what the agents observe.

One behavior with one agent per arena moves a pointer by an option `locomotion` and sees what the option `observation`
says.
"""

from abc import abstractmethod
from collections.abc import Iterable, Mapping
from typing import ClassVar

import numpy as np

from joybridge.games.locomotion import LOCOMOTIONS, observe_heading
from joybridge.games.pictures import Eye, Field, View, look, make_eye, open_eye
from joybridge.games.record_game import RecordGame
from joybridge.games.sight import image_sensor, sees_state, views
from joybridge.simulator import Array, StepArrays, quiet_step
from joybridge.v1 import bridge_pb2 as pb


class PointerGame(RecordGame):
    """Many arenas of a game with a pointer. Their records have a field "heading"."""

    field: ClassVar[Field]  # what its images show
    channels: ClassVar[list[pb.RewardChannel]]

    def __init__(
        self, options: Mapping[str, str], parameters: Mapping[str, float], arenas: int, first_arena: int, seed: int
    ) -> None:
        """Begin a first episode in every arena."""
        self.locomotion = LOCOMOTIONS[options["locomotion"]]
        self._numbers = self.numbers(options) if sees_state(options) else []
        self._cursor = options["cursor"] == "drawn"
        self._own_field = self.own_field(arenas)
        self._eyes = [
            (view, make_eye(view, self._own_field) if self._own_field else open_eye(view, self.field))
            for view in self.views(options).values()
        ]
        super().__init__(options, parameters, arenas, first_arena, seed)

    @classmethod
    @abstractmethod
    def numbers(cls, options: Mapping[str, str]) -> list[pb.Sensor]:
        """Return the sensors of the observation "state", without that of the locomotion."""

    @classmethod
    def views(cls, options: Mapping[str, str]) -> dict[str, View]:
        """Return the images that agents observe, by the names of their sensors."""
        return views(options, cls.field.half_width, cls.field.half_height)

    @classmethod
    def sensors(cls, options: Mapping[str, str]) -> list[pb.Sensor]:
        """Return what an agent observes: numbers, images or both, and the sensor of the locomotion."""
        images = [image_sensor(name, view) for name, view in cls.views(options).items()]
        numbers = cls.numbers(options) if sees_state(options) else []
        return [*numbers, *images, *LOCOMOTIONS[options["locomotion"]].sensors]

    def own_field(self, arenas: int) -> Field | None:
        """Return what images show if every arena has a level of its own; None: `field`.

        The game calls `look_at_ground` whenever its levels have changed.
        """
        return None

    def look_at_ground(self, levels: Iterable[int]) -> None:
        """Let images show the present state of some levels of an own field."""
        for _, eye in self._eyes:
            if self._own_field:
                look(eye, self._own_field, levels)

    def observe(self) -> list[StepArrays]:
        """Return the current observations, with zero rewards and no episode ends."""
        return [quiet_step(self.observations(self.arenas), len(self.channels))]

    def observations(self, arenas: Array) -> list[Array]:
        """Return the current observations of some arenas, records of `arena_dtype`: [arenas, *shape] per sensor."""
        observed = []
        if self._numbers:
            observed = [np.empty((len(arenas), *sensor.shape), np.float32) for sensor in self._numbers]
            self.write_numbers(arenas, *observed)
        for view, eye in self._eyes:
            observed.append(np.empty((len(arenas), view.height, view.width, view.channels), np.uint8))
            self.paint(arenas, eye, self._cursor and not view.centered, observed[-1])
        if self.locomotion.sensors:
            observed.append(observe_heading(arenas["heading"]))
        return observed

    @abstractmethod
    def write_numbers(self, arenas: Array, *values: Array) -> None:
        """Write the values of every sensor of `numbers`, float32 [arenas, *shape]."""

    @abstractmethod
    def paint(self, arenas: Array, eye: Eye, cursor: bool, images: Array) -> None:
        """Paint what the agents see into `images`, uint8 [arenas, height, width, channels], the pointer if `cursor`."""
