"""`BatchedGame`, which the server runs: all arenas of a session, advanced by one call per decision.

Each session plays its game in a thread of its own, so a game keeps no state outside its instances.

Games that are fast implement it directly, as those of the paper do. Others are written as a one-arena `Game`, and
`game_adapter.py` turns those into a BatchedGame.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import ClassVar

import numpy as np

from joybridge.contract.codec import ActArrays, StepArrays
from joybridge.contract.errors import JoybridgeError
from joybridge.contract.tensors import Array
from joybridge.v1 import bridge_pb2 as pb


class GameError(JoybridgeError):
    """A mistake in a game. The message names the arena where it is known."""


class ArenaError(GameError):
    """A mistake of a game in one arena. The message names it."""

    def __init__(self, arena: int, text: str) -> None:
        """arena: its number in the session. text: the message without it."""
        super().__init__(f"arena {arena}: {text}")
        self.arena, self.text = arena, text


class BatchedGame(ABC):
    """Many arenas of one game. The session validates all inputs before they reach the game.

    Arena i of a session plays arena `first_arena + i` of the seed: its randomness depends on the seed and that
    number only, never on the number of arenas.
    """

    name: ClassVar[str]
    description: ClassVar[str]
    options: ClassVar[Sequence[pb.Option]] = ()
    version: ClassVar[str] = ""  # of the rules; see Game
    # True: a step takes microseconds and always ends, so it has no time limit, and for clients over gRPC the server may
    # step the game in its event loop, where a round trip is twice as fast. Everything else that the game does, and slow
    # steps, still run in the session's thread.
    in_event_loop: ClassVar[bool] = False

    # Parameter name -> how it is drawn when an episode begins (see `draw_parameters`); the others keep their values.
    # The session sets this before a step or a reset, only for games whose spec says parameters_per_episode.
    distributions: Mapping[str, pb.Distribution] = MappingProxyType({})

    # The arena of which a game that can draws the ticks of the next step, all but the last, into `tick_pictures`, each
    # uint8 [height, width, 3]. The session sets it before every step.
    drawn_by_tick: int | None = None
    tick_pictures: Sequence[Array] = ()

    @classmethod
    @abstractmethod
    def describe(cls, options: Mapping[str, str]) -> pb.GameSpec:
        """Return the spec for the chosen value of every option. Build it with `spec`."""

    @abstractmethod
    def __init__(
        self, options: Mapping[str, str], parameters: Mapping[str, float], arenas: int, first_arena: int, seed: int
    ) -> None:
        """Begin a first episode in every arena. `parameters` has only those that were given; others are default."""

    @abstractmethod
    def reset(self, seed: int | None, parameters: Mapping[str, float]) -> None:
        """Begin a new episode in every arena. With a seed, do what a new session with that seed would do."""

    @abstractmethod
    def observe(self) -> list[StepArrays]:
        """Return the current observations, one StepArrays per behavior, with zero rewards and no episode ends."""

    @abstractmethod
    def step(self, acts: list[ActArrays]) -> list[StepArrays]:
        """Advance every arena by one decision. `acts` and the result have one entry per behavior."""

    def draw(self, arena: int) -> Array:
        """Return a picture of one arena, uint8 [height, width, 3]. Required if the spec has a picture size."""
        raise NotImplementedError(f"{self.name} has a picture size in its spec but no draw method")

    def save(self) -> dict[str, Array]:
        """Return the whole state as named arrays. Required if the spec allows snapshots."""
        raise NotImplementedError(f"{self.name} allows snapshots in its spec but has no save method")

    def restore(self, state: Mapping[str, Array]) -> None:
        """Restore what `save` returned. Names, dtypes and shapes are checked already, values are not.

        Raises ValueError for a state that the game cannot be in.
        """
        raise NotImplementedError(f"{self.name} allows snapshots in its spec but has no restore method")

    def close(self) -> None:
        """Free what the garbage collection does not, such as processes. Called once, when the session has ended."""
        return


def quiet_step(observations: list[Array], channels: int) -> StepArrays:
    """Return a step with these observations (one [lanes, *shape] per sensor), zero rewards and no episode ends."""
    lanes = len(observations[0])
    zeros = np.zeros(lanes, bool)
    return StepArrays(observations, np.zeros((lanes, channels), np.float32), zeros, zeros.copy())


def check_range(what: str, values: Array, low: float, high: float) -> None:
    """Raise ValueError unless all values are in low..high (NaN is not). For `restore`: a snapshot may be forged."""
    if not ((values >= low) & (values <= high)).all():
        raise ValueError(f"{what} is outside {low:g}..{high:g}")
