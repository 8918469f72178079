"""One session over several games, with the interface of `Session`: each plays in some of the lanes.

What the games show and what their devices get goes through a translation each, to and from a common spec. So whoever
plays here sees one game with one behavior.
"""

from collections.abc import Sequence
from contextlib import ExitStack
from typing import Protocol

import numpy as np

from joybridge.client.client import Distributions, Session
from joybridge.client.sharded_session import ShardedSession
from joybridge.contract.codec import ActArrays, StepArrays
from joybridge.contract.sharding import join
from joybridge.contract.tensors import Array
from joybridge.v1 import bridge_pb2 as pb


class Translation(Protocol):
    """How the lanes of one game become lanes of the common spec."""

    def step(self, step: StepArrays) -> StepArrays:
        """Return a step of the game as one of the common spec."""

    def act(self, act: ActArrays) -> ActArrays:
        """Return what the game's device gets, from the actions of the common device."""


class SeveralSession:
    """Sessions of several games as one. `steps` holds the last step, of the only behavior."""

    def __init__(
        self,
        games: Sequence[Session | ShardedSession],
        arenas: Sequence[int],
        translations: Sequence[Translation],
        spec: pb.GameSpec,
    ) -> None:
        """Take open sessions, their arenas of one agent each, and how each game is translated. spec: the common one."""
        self.spec, self._games, self._translations = spec, list(games), list(translations)
        self._bounds = [0, *np.cumsum(arenas).tolist()]
        self.sessions = [
            one for game in games for one in (game.sessions if isinstance(game, ShardedSession) else [game])
        ]
        self.steps = self._join([game.steps for game in games])

    @property
    def simulate_seconds(self) -> float:
        """Return the time that the games themselves took for the last step, one after the other."""
        return sum(game.simulate_seconds for game in self._games)

    def send(self, acts: Sequence[ActArrays]) -> None:
        """Send the actions of one timestep without waiting; `receive` returns the step. Raises SimulatorError."""
        for game, own in zip(self._games, self._split(acts), strict=True):
            game.send([own])

    def receive(self) -> list[StepArrays]:
        """Wait for the step after the last `send` and return it. Raises SimulatorError."""
        self.steps = self._join([game.receive() for game in self._games])
        return self.steps

    def step(self, acts: Sequence[ActArrays]) -> list[StepArrays]:
        """Advance every arena by one timestep and return the step. Raises SimulatorError."""
        self.send(acts)
        return self.receive()

    def step_and_draw(self, acts: Sequence[ActArrays], draw: Sequence[int]) -> tuple[list[StepArrays], list[Array]]:
        """Like `step`; also return pictures of some arenas of the first game, uint8 [height, width, 3] each."""
        first, *others = self._split(acts)
        for game, own in zip(self._games[1:], others, strict=True):
            game.send([own])
        game = self._games[0]
        if not isinstance(game, Session):
            raise ValueError("a game at several simulators cannot be drawn")
        steps, pictures = game.step_and_draw([first], draw)
        self.steps = self._join([steps, *(game.receive() for game in self._games[1:])])
        return self.steps, pictures

    def distribute(self, distributions: Distributions) -> None:
        """Refuse: each game draws its own parameters, and no lesson changes them."""
        raise ValueError("several games have no lessons")

    def close(self) -> None:
        """End all sessions."""
        with ExitStack() as closing:
            for game in self._games:
                closing.callback(game.close)

    def _split(self, acts: Sequence[ActArrays]) -> list[ActArrays]:
        """Return what the device of each game gets."""
        (act,) = acts
        parts = [slice(*bounds) for bounds in zip(self._bounds, self._bounds[1:], strict=False)]
        return [
            translation.act(ActArrays(act.axes[lanes], act.choices[lanes]))
            for translation, lanes in zip(self._translations, parts, strict=True)
        ]

    def _join(self, steps: Sequence[Sequence[StepArrays]]) -> list[StepArrays]:
        """Return the steps of all games as one of the common spec."""
        return join([[own.step(step)] for own, (step,) in zip(self._translations, steps, strict=True)])
