"""Mean and variance of numbers that come in over time. Needs no torch."""

import numpy as np

from joybridge.contract.tensors import Array

EPSILON = 1e-8  # added to variances


class Moments:
    """Mean and variance of rows of numbers, in float64. The same rows in the same order give the same bits."""

    def __init__(self, size: int) -> None:
        """Begin without rows. size: numbers per row."""
        self.count = np.zeros(1)
        self.mean = np.zeros(size)
        self.squares = np.zeros(size)  # of the differences from the mean

    def add(self, rows: Array) -> None:
        """Count rows [n, size] (Chan, Golub and LeVeque 1979)."""
        if not len(rows):
            return
        numbers = rows.astype(np.float64)
        mean = numbers.mean(0)
        squares = np.square(numbers - mean).sum(0)
        total, difference = self.count + len(rows), mean - self.mean
        self.squares += squares + np.square(difference) * (self.count * len(rows) / total)
        self.mean += difference * (len(rows) / total)
        self.count = total

    def deviation(self) -> Array:
        """Return the standard deviation, never 0, [size]; 1 before there are rows."""
        if not self.count[0]:
            return np.ones_like(self.mean)
        return np.sqrt(self.squares / self.count + EPSILON)

    def state(self) -> dict[str, Array]:
        """Return copies of everything, for a checkpoint."""
        return {"count": self.count.copy(), "mean": self.mean.copy(), "squares": self.squares.copy()}

    def load(self, state: dict[str, Array]) -> None:
        """Take back what `state` returned."""
        self.count, self.mean, self.squares = (state[name].copy() for name in ("count", "mean", "squares"))
