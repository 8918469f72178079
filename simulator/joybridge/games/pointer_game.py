"""`PointerGame`: what Shooting Birds and Beastly Rivals share. Arenas are records, advanced by compiled rules.

One behavior with one agent per arena moves a pointer by an option `locomotion`. This class holds the arenas, their
random streams and the parameters, resets and observes them, and saves and restores snapshots.
"""

from abc import abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from joybridge.games.locomotion import LOCOMOTIONS, observe_heading
from joybridge.simulator import Array, BatchedGame, StepArrays, check_range, quiet_step
from joybridge.simulator.randomness import Streams, open_streams, restore_streams, save_streams
from joybridge.v1 import bridge_pb2 as pb


class PointerGame(BatchedGame):
    """Many arenas of a game with a pointer.

    A subclass sets `rules` before it calls `__init__` here: a NamedTuple with a field for every parameter of the
    game, of the same name. Its arena records have a field "heading".
    """

    in_event_loop: ClassVar[bool] = True
    arena_dtype: ClassVar[np.dtype[Any]]  # of the record of one arena
    parameters: ClassVar[list[pb.Parameter]]
    sensors: ClassVar[list[pb.Sensor]]  # without that of the locomotion
    channels: ClassVar[list[pb.RewardChannel]]

    rules: Any
    streams: Streams

    def __init__(
        self, options: Mapping[str, str], parameters: Mapping[str, float], arenas: int, first_arena: int, seed: int
    ) -> None:
        """Begin a first episode in every arena."""
        self.locomotion = LOCOMOTIONS[options["locomotion"]]
        self.first_arena = first_arena
        self.arenas = np.zeros(arenas, self.arena_dtype).view(np.recarray)
        self.fields = self.arenas.view(np.ndarray)  # the same memory; attributes of a recarray are slow to look up
        self._shapes = [(arenas, *sensor.shape) for sensor in self.sensors]
        self.reset(seed, parameters)

    def reset(self, seed: int | None, parameters: Mapping[str, float]) -> None:
        """Begin a new episode in every arena; see BatchedGame."""
        self.rules = self.rules._replace(**parameters)
        if seed is None:
            self.begin_episodes()
        else:
            self.streams = open_streams(seed, self.first_arena, len(self.arenas))
            self.begin()

    @abstractmethod
    def begin(self) -> None:
        """Fill all arenas as at the start of the program, with a first episode each."""

    @abstractmethod
    def begin_episodes(self) -> None:
        """Begin a new episode in every arena of a running program."""

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

    def save(self) -> dict[str, Array]:
        """Return arenas, random streams and parameters."""
        return {
            "arenas": np.frombuffer(self.arenas.tobytes(), np.uint8).reshape(len(self.arenas), -1),
            **save_streams(self.streams),
            **{parameter.name: np.array([getattr(self.rules, parameter.name)]) for parameter in self.parameters},
        }

    def restore(self, state: Mapping[str, Array]) -> None:
        """Restore what `save` returned. Raises ValueError for a state that the game cannot be in."""
        arenas = np.frombuffer(state["arenas"].tobytes(), self.arena_dtype)
        self.check_arenas(arenas)
        for parameter in self.parameters:
            check_range(parameter.name, state[parameter.name], parameter.low, parameter.high)
        restore_streams(self.streams, state)
        self.arenas[:] = arenas
        self.rules = self.rules._replace(**{p.name: float(state[p.name][0]) for p in self.parameters})

    @abstractmethod
    def check_arenas(self, arenas: Array) -> None:
        """Raise ValueError if arenas of a snapshot, records of `arena_dtype`, are in a state that cannot occur."""
