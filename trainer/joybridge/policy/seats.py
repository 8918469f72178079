"""Who plays: the seats of some arenas, one for each agent, who holds them, and the results of matches.

An episode of an arena is a match of those who hold its seats. When the episode of an agent ends, its seat goes to the
one who was dealt in for the next match. Seats are the agents of all behaviors, in the order of the spec.
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from joybridge.contract.codec import StepArrays
from joybridge.contract.tensors import Array
from joybridge.v1 import bridge_pb2 as pb

PLACE = "place"  # the metric with which a game says who was first; without it, the rewards of the episode decide


class Result(NamedTuple):
    """The end of a match."""

    arena: int
    holders: Array  # int [seats]
    scores: Array  # [seats]: the rewards of the episode, or the negative of the place that the game says

    @property
    def places(self) -> Array:
        """Return the places [seats]; the lowest is the best, and equal players share the mean of their places."""
        return places_of(self.scores)


class Seats:
    """The seats of some arenas. Holders are numbers; whose they are is up to the caller."""

    def __init__(self, spec: pb.GameSpec, arenas: int) -> None:
        """Give all seats to holder 0."""
        ends = np.cumsum([0, *(behavior.agents_per_arena for behavior in spec.behaviors)])
        self.count = int(ends[-1])  # of an arena
        self._columns = [slice(first, end) for first, end in pairwise(ends.tolist())]
        self._weights = [[channel.default_weight for channel in one.channels] for one in spec.behaviors]
        metrics = ([metric.name for metric in one.metrics] for one in spec.behaviors)
        self._place = [names.index(PLACE) if PLACE in names else None for names in metrics]
        self._holders, self._dealt = (np.zeros((arenas, self.count), np.int64) for _ in range(2))
        self._rewards, self._scores = (np.zeros((arenas, self.count)) for _ in range(2))
        self._earners = np.zeros((arenas, self.count), np.int64)  # who held each seat that has ended
        self._ended = np.zeros((arenas, self.count), bool)  # seats whose episode of the present match is over

    def holders(self, behavior: int) -> Array:
        """Return who holds the agents of a behavior, int [lanes]."""
        return self._holders[:, self._columns[behavior]].reshape(-1)

    @property
    def dealt(self) -> Array:
        """Return who holds the seats in the next match of each arena, int [arenas, seats]."""
        return self._dealt.copy()

    @property
    def present(self) -> set[int]:
        """Return all holders of seats, now or in the next match."""
        return {*np.unique(self._holders).tolist(), *np.unique(self._dealt).tolist()}

    def begin(self, arena: int, holders: Sequence[int] | Array) -> None:
        """Begin a match of an arena in which nothing has been played. holders [seats]."""
        self._holders[arena] = self._dealt[arena] = holders
        self._rewards[arena], self._ended[arena] = 0.0, False

    def deal(self, arena: int, holders: Sequence[int] | Array) -> None:
        """Say who holds the seats [seats] of an arena in the next match."""
        self._dealt[arena] = holders

    def finish(self, steps: Sequence[StepArrays]) -> list[Result]:
        """Count the rewards and the ends in a step; return the matches that are over in it.

        One that an error of the game has cut has no result: the same players start over.
        """
        over, cut = False, set[int]()
        for step, columns, weights, place in zip(steps, self._columns, self._weights, self._place, strict=True):
            shape = self._holders[:, columns].shape
            self._rewards[:, columns] += (step.rewards @ np.array(weights, np.float32)).reshape(shape)
            if not len(step.ended):
                continue
            ends = step.ends.reshape(shape)
            scores = self._rewards[:, columns].copy()
            if place is not None and step.metrics is not None:
                scores[ends] = -step.metrics[:, place]
            new = ends & ~self._ended[:, columns]
            self._scores[:, columns][new] = scores[new]
            self._earners[:, columns][new] = self._holders[:, columns][new]
            self._ended[:, columns] |= ends
            self._rewards[:, columns][ends] = 0.0
            if step.interrupted is not None:
                cut.update((step.ended[step.interrupted] // shape[1]).tolist())
            over = True
        if not over:
            return []
        arenas = np.flatnonzero(self._ended.all(axis=1))
        results = [Result(int(a), self._earners[a].copy(), self._scores[a].copy()) for a in arenas if a not in cut]
        self._ended[arenas] = False
        return results

    def sit(self, steps: Sequence[StepArrays]) -> None:
        """Give the seats whose episodes ended in a step to those who were dealt in."""
        for step, columns in zip(steps, self._columns, strict=True):
            if len(step.ended):
                ends = step.ends.reshape(self._holders[:, columns].shape)
                self._holders[:, columns][ends] = self._dealt[:, columns][ends]

    def state(self) -> dict[str, Array]:
        """Return copies of everything, for a checkpoint."""
        names = ("holders", "dealt", "rewards", "scores", "earners", "ended")
        return {name: getattr(self, f"_{name}").copy() for name in names}

    def load(self, state: dict[str, Array]) -> None:
        """Take back what `state` returned."""
        for name, array in state.items():
            getattr(self, f"_{name}")[:] = array


def places_of(scores: Array) -> Array:
    """Return the places [seats] of scores, the highest first; equal scores share the mean of their places.

    Scores that differ by rounding errors are equal.
    """
    difference = scores[None, :] - scores[:, None]
    equal = np.isclose(difference, 0.0, atol=1e-6)
    places: Array = 1 + ((difference > 0) & ~equal).sum(axis=1) + (equal.sum(axis=1) - 1) / 2
    return places
