"""Scaling of what a policy sees: by the bounds of its sensors, or by the moments of what it has seen in training.

A frame x becomes (x - shift) · scale before it is stacked; with moments it is limited to ±LIMIT. Needs no torch.
"""

from collections.abc import Sequence

import numpy as np

from joybridge.contract.limits import element_count
from joybridge.contract.tensors import Array
from joybridge.trainer.errors import ConfigError
from joybridge.trainer.images import Image
from joybridge.v1 import bridge_pb2 as pb

LIMIT = 10.0  # what is farther away is no better known
EPSILON = 1e-8  # added to variances
NO_BOUND = np.finfo(np.float32).max / 2  # games write the largest number of a type where they have no bound


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


class Scaling:
    """How the frames of one policy are scaled. `moments` is None if training does not change it."""

    def __init__(self, shift: Array, scale: Array, columns: Array | None = None) -> None:
        """Take float32 [frame] each. columns: where moments replace them; None: nowhere."""
        self.shift, self.scale = shift, scale
        self._columns = columns
        self.moments = None if columns is None else Moments(len(columns))

    def apply(self, frames: Array) -> Array:
        """Return frames [rows, frame] as a policy gets them, float32."""
        scaled = (frames - self.shift) * self.scale
        return scaled if self.moments is None else np.clip(scaled, np.float32(-LIMIT), np.float32(LIMIT))

    def watch(self, frames: Array) -> None:
        """Count frames [rows, frame], unscaled, that training has shown; they count from the next `refresh`."""
        if self.moments is not None:
            self.moments.add(frames[:, self._columns])

    def refresh(self) -> None:
        """Scale by all that was watched. Training does so between two rollouts only."""
        if self.moments is not None:
            self.shift[self._columns] = self.moments.mean
            self.scale[self._columns] = 1.0 / self.moments.deviation()

    def state(self) -> dict[str, Array]:
        """Return copies of what training changes."""
        return {} if self.moments is None else self.moments.state()

    def load(self, state: dict[str, Array]) -> None:
        """Take back what `state` returned."""
        if self.moments is not None:
            self.moments.load(state)
            self.refresh()


def make_scaling(policy: str, kind: str, sensors: Sequence[pb.Sensor], images: Sequence[Image]) -> Scaling | None:
    """Return how to scale the sensors of a policy, None if there is nothing to do.

    images: of `find_images`. Their pixels are scaled from 0..255 to 0..1 if they are uint8, and not at all otherwise.
    Raises ConfigError for "bounds" if no sensor has any.
    """
    size = sum(element_count(sensor) for sensor in sensors)
    shift, scale, numbers = np.zeros(size, np.float32), np.ones(size, np.float32), np.ones(size, bool)
    uint8 = np.repeat([sensor.dtype == pb.DTYPE_UINT8 for sensor in sensors], [*map(element_count, sensors)])
    for image in images:
        numbers[image.begin : image.end] = False
    scale[uint8 & ~numbers] = 1 / 255
    if kind == "none":
        return Scaling(shift, scale) if (scale != 1).any() else None
    if kind == "running":
        return Scaling(shift, scale, np.flatnonzero(numbers))
    low, high = (np.concatenate(part) for part in zip(*map(_bounds, sensors), strict=True))
    known = (np.abs(low) < NO_BOUND) & (np.abs(high) < NO_BOUND) & (low < high) & numbers
    if not known.any():
        names = ", ".join(sensor.name for sensor in sensors)
        raise ConfigError(
            f"{policy}: scale_observations is bounds, but no sensor has any ({names}); set scale_observations=running"
        )
    shift[known] = (low[known] + high[known]) / 2
    scale[known] = 2 / (high[known] - low[known])
    return Scaling(shift, scale)


def _bounds(sensor: pb.Sensor) -> tuple[Array, Array]:
    """Return the bounds of each element, float64, infinite where there are none."""
    whole = {pb.DTYPE_UINT8: (0.0, 255.0), pb.DTYPE_BOOL: (0.0, 1.0)}.get(sensor.dtype, (-np.inf, np.inf))
    size = element_count(sensor)
    low, high = (
        np.broadcast_to(np.array(given or [other], np.float64), size)
        for given, other in zip((list(sensor.low), list(sensor.high)), whole, strict=True)
    )
    return low, high
