"""Scaling of rewards: divided by the standard deviation of the discounted returns so far, of each game its own."""

import numpy as np

from joybridge.contract.tensors import Array
from joybridge.ppo.moments import Moments


class ReturnScale:
    """The discounted sum of the rewards of each lane's present episode, and the moments of these sums per game."""

    def __init__(self, lanes: int, gamma: float, kinds: Array | None = None) -> None:
        """Begin new episodes in so many lanes. kinds: which game each lane plays, int [lanes]; None: all the same."""
        self._returns, self._gamma = np.zeros(lanes), gamma
        self._kinds = np.zeros(lanes, int) if kinds is None else kinds
        self._moments = [Moments(1) for _ in range(int(self._kinds.max()) + 1)]

    def scale(self, rewards: Array, decided: Array, ended: Array) -> Array:
        """Return the rewards of a rollout, scaled, float32 [steps, lanes].

        decided, ended: bool [steps, lanes], as in `gae`: rows where nothing was decided do not count.
        """
        for step, live in enumerate(decided):
            self._returns[live] = self._returns[live] * self._gamma + rewards[step, live]
            for kind, moments in enumerate(self._moments):
                moments.add(self._returns[live & (self._kinds == kind), None])
            self._returns[live & ended[step]] = 0.0
        deviations = np.concatenate([moments.deviation() for moments in self._moments])
        return rewards / deviations.astype(np.float32)[self._kinds]

    def state(self) -> dict[str, Array]:
        """Return copies of everything, for a checkpoint."""
        each = [moments.state() for moments in self._moments]
        return {"returns": self._returns.copy(), **{name: np.stack([one[name] for one in each]) for name in each[0]}}

    def begin_with(self, moments: dict[str, Array], count: int) -> None:
        """Begin with the moments of other returns, which its critic has learned, as if there had been `count` at most.

        Nothing is taken of several games, and of a run in which nothing was decided.
        """
        if len(self._moments) == len(moments["count"]) == 1 and moments["count"][0, 0]:
            share = min(1.0, count / float(moments["count"][0, 0]))
            fewer = {"count": moments["count"][0] * share, "mean": moments["mean"][0]}
            self._moments[0].load({**fewer, "squares": moments["squares"][0] * share})

    def load(self, state: dict[str, Array]) -> None:
        """Take back what `state` returned."""
        self._returns = state["returns"].copy()
        for kind, moments in enumerate(self._moments):
            moments.load({name: array[kind] for name, array in state.items() if name != "returns"})
