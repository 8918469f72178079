"""Scaling of what a policy sees: by the bounds of its sensors, or by the moments of what it has seen in training.

A frame x becomes (x - shift) · scale before it is stacked; with moments it is limited to ±LIMIT. Needs no torch.
"""

from collections.abc import Sequence

import numpy as np

from joybridge.config.errors import ConfigError
from joybridge.contract.limits import element_count
from joybridge.contract.tensors import Array
from joybridge.ppo.moments import Moments
from joybridge.v1 import bridge_pb2 as pb

LIMIT = 10.0  # what is farther away is no better known
NO_BOUND = np.finfo(np.float32).max / 2  # games write the largest number of a type where they have no bound


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


def make_scaling(policy: str, kind: str, sensors: Sequence[pb.Sensor]) -> Scaling | None:
    """Return how to scale the sensors of a policy that are no images, None if there is nothing to do.

    Raises ConfigError for "bounds" if no sensor has any.
    """
    if kind == "none" or not sensors:
        return None
    if kind == "running":
        size = sum(element_count(sensor) for sensor in sensors)
        return Scaling(np.zeros(size, np.float32), np.ones(size, np.float32), np.arange(size))
    scaling = scaling_by_bounds(sensors)
    if scaling is None:
        names = ", ".join(sensor.name for sensor in sensors)
        raise ConfigError(
            f"{policy}: scale_observations is bounds, but no sensor has any ({names}); set scale_observations=running"
        )
    return scaling


def scaling_by_bounds(sensors: Sequence[pb.Sensor]) -> Scaling | None:
    """Return how numbers of these sensors, side by side, get from their bounds to -1..1; None if none has bounds."""
    if not sensors:
        return None
    low, high = (np.concatenate(part) for part in zip(*map(_bounds, sensors), strict=True))
    known = _known(low, high)
    shift, scale = np.zeros(len(low), np.float32), np.ones(len(low), np.float32)
    shift[known] = (low[known] + high[known]) / 2
    scale[known] = 2 / (high[known] - low[known])
    return Scaling(shift, scale) if known.any() else None


def is_bounded(sensor: pb.Sensor) -> bool:
    """Return whether all elements of a sensor have bounds."""
    return bool(_known(*_bounds(sensor)).all())


def _known(low: Array, high: Array) -> Array:
    """Return which elements have bounds, bool, from those of `_bounds`."""
    known: Array = (np.abs(low) < NO_BOUND) & (np.abs(high) < NO_BOUND) & (low < high)
    return known


def _bounds(sensor: pb.Sensor) -> tuple[Array, Array]:
    """Return the bounds of each element, float64, infinite where there are none."""
    whole = {pb.DTYPE_UINT8: (0.0, 255.0), pb.DTYPE_BOOL: (0.0, 1.0)}.get(sensor.dtype, (-np.inf, np.inf))
    size = element_count(sensor)
    low, high = (
        np.broadcast_to(np.array(given or [other], np.float64), size)
        for given, other in zip((list(sensor.low), list(sensor.high)), whole, strict=True)
    )
    return low, high
