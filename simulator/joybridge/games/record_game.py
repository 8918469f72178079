"""`RecordGame`: what games share whose arenas are records, advanced by compiled rules.

This class holds the arenas, their random streams and the parameters, resets them, and saves and restores snapshots.
"""

from abc import abstractmethod
from collections.abc import Callable, Mapping
from typing import Any, ClassVar

import numpy as np

from joybridge.simulator import Array, BatchedGame, check_range, spec
from joybridge.simulator.distributions import draw_parameters
from joybridge.simulator.randomness import Streams, open_streams, restore_streams, save_streams
from joybridge.v1 import bridge_pb2 as pb

STREAM_BYTES = 64  # that the stream of an arena and the number of its episode take in a snapshot, at most


class RecordGame(BatchedGame):
    """Many arenas of one game, one record each.

    The record has a field for every parameter of the game, of the same name. What begins an episode calls
    `draw_parameters` before.
    """

    in_event_loop: ClassVar[bool] = True
    arena_dtype: ClassVar[np.dtype[Any]]  # of the record of one arena
    parameters: ClassVar[list[pb.Parameter]]

    streams: Streams

    @classmethod
    def record_spec(
        cls, agent: pb.Behavior, *, picture: tuple[int, int], max_arenas: int = 4096, **more: Any
    ) -> pb.GameSpec:
        """Return the spec of a game of one behavior, which has snapshots, and parameters that may be drawn.

        more: see `spec`.
        """
        return spec(
            cls,
            [agent],
            parameters=cls.parameters,
            max_arenas=max_arenas,
            picture=picture,
            snapshot_bytes_per_arena=cls.arena_dtype.itemsize + STREAM_BYTES,
            parameters_per_episode=bool(cls.parameters),
            **more,
        )

    def __init__(
        self, options: Mapping[str, str], parameters: Mapping[str, float], arenas: int, first_arena: int, seed: int
    ) -> None:
        """Begin a first episode in every arena."""
        self.first_arena = first_arena
        self.arenas = np.zeros(arenas, self.arena_dtype).view(np.recarray)
        self.fields = self.arenas.view(np.ndarray)  # the same memory; attributes of a recarray are slow to look up
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

    def play_ticks(self, ticks: int, play: Callable[[Array, Streams, Array, int], None], rewards: Array) -> None:
        """Advance every arena by the ticks of a decision, and draw them if the session wants to see them.

        play: advances the records of arenas, with their streams, by the first so many ticks of the decision, and writes
        their rewards. What is seen on the way is played by copies, so that nothing depends on who looks.
        """
        self.tick_pictures = seen = []
        for count in range(1, ticks) if self.drawn_by_tick is not None else ():
            arenas: Any = self.arenas.copy()
            play(arenas, Streams(*(part.copy() for part in self.streams)), rewards.copy(), count)
            seen.append(self.draw_record(arenas[self.drawn_by_tick]))
        play(self.arenas, self.streams, rewards, ticks)

    def draw(self, arena: int) -> Array:
        """Return a picture of one arena, uint8 [height, width, 3]."""
        return self.draw_record(self.arenas[arena])

    @abstractmethod
    def draw_record(self, arena: np.record) -> Array:
        """Return a picture of the record of an arena, uint8 [height, width, 3]."""

    def played_parameters(self, arenas: Array) -> Array | None:
        """Return the parameters of episodes that end, float32 [ended, parameters]; None if none of them is drawn.

        arenas: indices of the ended ones. Call it before `draw_parameters`.
        """
        if not self.distributions:
            return None
        columns = [self.fields[parameter.name][arenas] for parameter in self.parameters]
        return np.stack(columns, axis=1).astype(np.float32)

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
