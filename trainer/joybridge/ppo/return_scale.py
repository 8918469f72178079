"""Scaling of rewards: divided by the standard deviation of the discounted returns so far."""

import numpy as np

from joybridge.contract.tensors import Array
from joybridge.ppo.moments import Moments


class ReturnScale:
    """The discounted sum of the rewards of each lane's present episode, and the moments of all these sums."""

    def __init__(self, lanes: int, gamma: float) -> None:
        """Begin new episodes in so many lanes."""
        self._returns, self._gamma = np.zeros(lanes), gamma
        self._moments = Moments(1)

    def scale(self, rewards: Array, decided: Array, ended: Array) -> Array:
        """Return the rewards of a rollout, scaled, float32 [steps, lanes].

        decided, ended: bool [steps, lanes], as in `gae`: rows where nothing was decided do not count.
        """
        for step, live in enumerate(decided):
            self._returns[live] = self._returns[live] * self._gamma + rewards[step, live]
            self._moments.add(self._returns[live, None])
            self._returns[live & ended[step]] = 0.0
        return rewards / self._moments.deviation().astype(np.float32)

    def state(self) -> dict[str, Array]:
        """Return copies of everything, for a checkpoint."""
        return {"returns": self._returns.copy(), **self._moments.state()}

    def load(self, state: dict[str, Array]) -> None:
        """Take back what `state` returned."""
        self._returns = state["returns"].copy()
        self._moments.load(state)
