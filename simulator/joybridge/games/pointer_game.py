"""`PointerGame`: what Shooting Birds and Beastly Rivals share. Arenas are records, advanced by compiled rules.

One behavior with one agent per arena moves a pointer by an option `locomotion` and sees what the option `observation`
says. This class holds the arenas, their random streams and the parameters, resets and observes them, and saves and
restores snapshots.
"""

from abc import abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from joybridge.games.locomotion import LOCOMOTIONS, observe_heading
from joybridge.games.pictures import Eye, Field, View, open_eye
from joybridge.games.sight import image_sensor, sees_state, views
from joybridge.simulator import Array, BatchedGame, StepArrays, check_range, quiet_step
from joybridge.simulator.distributions import draw_parameters
from joybridge.simulator.randomness import Streams, open_streams, restore_streams, save_streams
from joybridge.v1 import bridge_pb2 as pb


class PointerGame(BatchedGame):
    """Many arenas of a game with a pointer.

    Its arena records have a field "heading", and one for every parameter of the game, of the same name. What begins an
    episode calls `draw_parameters` before.
    """

    in_event_loop: ClassVar[bool] = True
    arena_dtype: ClassVar[np.dtype[Any]]  # of the record of one arena
    parameters: ClassVar[list[pb.Parameter]]
    numbers: ClassVar[list[pb.Sensor]]  # the sensors of the observation "state", without that of the locomotion
    field: ClassVar[Field]  # what its images show
    channels: ClassVar[list[pb.RewardChannel]]

    streams: Streams

    def __init__(
        self, options: Mapping[str, str], parameters: Mapping[str, float], arenas: int, first_arena: int, seed: int
    ) -> None:
        """Begin a first episode in every arena."""
        self.locomotion = LOCOMOTIONS[options["locomotion"]]
        self.first_arena = first_arena
        self.arenas = np.zeros(arenas, self.arena_dtype).view(np.recarray)
        self.fields = self.arenas.view(np.ndarray)  # the same memory; attributes of a recarray are slow to look up
        self._sees_state, self._cursor = sees_state(options), options["cursor"] == "drawn"
        self._eyes = [(view, open_eye(view, self.field)) for view in self.views(options).values()]
        self.episodes = np.zeros(arenas, np.int64)  # that have begun in each arena since the seed was set
        defaults = {parameter.name: parameter.default_value for parameter in self.parameters}
        self.reset(seed, defaults | dict(parameters))

    def reset(self, seed: int | None, parameters: Mapping[str, float]) -> None:
        """Begin a new episode in every arena; see BatchedGame."""
        for name, value in parameters.items():
            self.fields[name] = value
        every = np.arange(len(self.arenas))
        if seed is None:
            self.draw_parameters(every)
            self.begin_episodes()
            return
        self.streams = open_streams(seed, self.first_arena, len(self.arenas))
        self.episodes[:] = 0
        kept = {parameter.name: self.fields[parameter.name].copy() for parameter in self.parameters}
        self.fields[:] = np.zeros((), self.arena_dtype)
        for name, values in kept.items():
            self.fields[name] = values
        self.draw_parameters(every)
        self.begin()

    @classmethod
    def views(cls, options: Mapping[str, str]) -> dict[str, View]:
        """Return the images that agents observe, by the names of their sensors."""
        return views(options, cls.field.half_width, cls.field.half_height)

    @classmethod
    def sensors(cls, options: Mapping[str, str]) -> list[pb.Sensor]:
        """Return what an agent observes: numbers, images or both, and the sensor of the locomotion."""
        images = [image_sensor(name, view) for name, view in cls.views(options).items()]
        numbers = cls.numbers if sees_state(options) else []
        return [*numbers, *images, *LOCOMOTIONS[options["locomotion"]].sensors]

    @abstractmethod
    def begin(self) -> None:
        """Fill all arenas, which are zeros but for the parameters, as at the start of the program."""

    @abstractmethod
    def begin_episodes(self) -> None:
        """Begin a new episode in every arena of a running program. The parameters are those of the new ones."""

    def draw_parameters(self, arenas: Array) -> None:
        """Draw the parameters of the episodes that begin next in some arenas, given by their indices."""
        if self.distributions:
            for arena in arenas:
                key, episode = self.streams.key[arena], int(self.episodes[arena])
                for name, value in draw_parameters(self.distributions, self.parameters, key, episode).items():
                    self.fields[name][arena] = value
        self.episodes[arenas] += 1

    def played_parameters(self, arenas: Array) -> Array | None:
        """Return the parameters of episodes that end, float32 [ended, parameters]; None if none of them is drawn.

        arenas: indices of the ended ones. Call it before `draw_parameters`.
        """
        if not self.distributions:
            return None
        columns = [self.fields[parameter.name][arenas] for parameter in self.parameters]
        return np.stack(columns, axis=1).astype(np.float32)

    def observe(self) -> list[StepArrays]:
        """Return the current observations, with zero rewards and no episode ends."""
        return [quiet_step(self.observations(self.arenas), len(self.channels))]

    def observations(self, arenas: Array) -> list[Array]:
        """Return the current observations of some arenas, records of `arena_dtype`: [arenas, *shape] per sensor."""
        observed = []
        if self._sees_state:
            observed = [np.empty((len(arenas), *sensor.shape), np.float32) for sensor in self.numbers]
            self.write_numbers(arenas, *observed)
        for view, eye in self._eyes:
            observed.append(np.empty((len(arenas), view.height, view.width, view.channels), np.uint8))
            self.paint(arenas, eye, self._cursor and not view.centered, observed[-1])
        if self.locomotion.sensors:
            observed.append(observe_heading(arenas["heading"]))
        return observed

    @abstractmethod
    def write_numbers(self, arenas: Array, *values: Array) -> None:
        """Write the values of every sensor in `numbers`, float32 [arenas, *shape]."""

    @abstractmethod
    def paint(self, arenas: Array, eye: Eye, cursor: bool, images: Array) -> None:
        """Paint what the agents see into `images`, uint8 [arenas, height, width, channels], the pointer if `cursor`."""

    def save(self) -> dict[str, Array]:
        """Return arenas, with their parameters, and random streams."""
        return {
            "arenas": np.frombuffer(self.arenas.tobytes(), np.uint8).reshape(len(self.arenas), -1),
            **save_streams(self.streams),
            "episodes": self.episodes.copy(),
        }

    def restore(self, state: Mapping[str, Array]) -> None:
        """Restore what `save` returned. Raises ValueError for a state that the game cannot be in."""
        arenas = np.frombuffer(state["arenas"].tobytes(), self.arena_dtype)
        self.check_arenas(arenas)
        for parameter in self.parameters:
            check_range(parameter.name, arenas[parameter.name], parameter.low, parameter.high)
        check_range("episodes", state["episodes"], 1, 2**62)
        restore_streams(self.streams, state)
        self.arenas[:] = arenas
        self.episodes[:] = state["episodes"]

    @abstractmethod
    def check_arenas(self, arenas: Array) -> None:
        """Raise ValueError if arenas of a snapshot, records of `arena_dtype`, are in a state that cannot occur."""
