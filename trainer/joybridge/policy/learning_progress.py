"""How fast a policy gets better at each of several games, and how often it learns from each of them for that."""

from collections.abc import Sequence

import numpy as np

from joybridge.config.metrics import Row
from joybridge.contract.tensors import Array

RATES = np.array([0.1, 0.02])  # of two averages of the rewards, per update: a fast one and a slow one
EVEN = 0.5  # the part of what is learned from that all games share, so that none is forgotten
MOST = 2.0  # times that a timestep is learned from in an epoch, as a mean over its game


class LearningProgress:
    """Two averages of the rewards of each game, and what their distance says.

    The distance is large where rewards change now, be it for better or for worse: where a policy learns, and where it
    forgets. This is the measure of Kanitscheider et al. (2021), taken of rewards instead of successes. Rewards have to
    be scaled alike in all games.
    """

    def __init__(self, games: Sequence[str], kinds: Array) -> None:
        """Begin without rewards. games: their names. kinds: which of them each lane plays, int [lanes]."""
        self._games, self._kinds = games, kinds
        self._averages = np.zeros((2, len(games)))  # fast, slow
        self._updates = np.zeros(len(games))  # that have counted

    def watch(self, rewards: Array, decided: Array) -> None:
        """Take the scaled rewards of a rollout, [steps, lanes], where something was decided."""
        for game in range(len(self._games)):
            own = rewards[:, self._kinds == game][decided[:, self._kinds == game]]
            if len(own):
                self._updates[game] += 1
                # At first they are means of all that came, so that the zeros they begin with do not count.
                rates = np.maximum(RATES, 1.0 / self._updates[game])
                self._averages[:, game] += rates * (own.mean(dtype=float) - self._averages[:, game])

    def weights(self) -> Array:
        """Return how often timesteps of each game are learned from in an epoch, as a mean over them, [games]."""
        fast, slow = self._averages
        distances = np.abs(fast - slow)
        if not distances.sum():
            return np.ones(len(self._games))
        weights: Array = EVEN + (1.0 - EVEN) * len(self._games) * distances / distances.sum()
        return weights.clip(max=MOST)

    def times(self, decided: Array, rng: np.random.Generator) -> Array:
        """Return how often each timestep that was decided is learned from in an epoch, int [steps, lanes].

        Parts of one are rounded at random, with `rng`.
        """
        wanted = np.broadcast_to(self.weights()[self._kinds], decided.shape)
        times = np.where(decided, np.floor(wanted + rng.random(decided.shape)), 0).astype(np.int64)
        return times if times.any() else decided.astype(np.int64)

    def row(self, times: Array) -> Row:
        """Return the share of each game in what is learned from, for a row of metrics."""
        of_games = np.bincount(self._kinds, times.sum(axis=0), len(self._games)) / times.sum()
        return {f"{game}.share": float(share) for game, share in zip(self._games, of_games, strict=True)}

    def state(self) -> dict[str, Array]:
        """Return copies of everything, for a checkpoint."""
        return {"averages": self._averages.copy(), "updates": self._updates.copy()}

    def load(self, state: dict[str, Array]) -> None:
        """Take back what `state` returned."""
        self._averages, self._updates = state["averages"].copy(), state["updates"].copy()
