"""The observation space of Gymnasium that sensors have: in environments, and in datasets of Minari."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from gymnasium.spaces import Box, Dict

from joybridge.contract.limits import element_count
from joybridge.contract.tensors import NUMPY_TYPES, Array
from joybridge.v1 import bridge_pb2 as pb

_RANGES = {
    pb.DTYPE_FLOAT32: (-np.inf, np.inf),
    pb.DTYPE_INT32: (-(2.0**31), 2.0**31),
    pb.DTYPE_UINT8: (0.0, 255.0),
    pb.DTYPE_BOOL: (0.0, 1.0),
}


def make_observation_space(sensors: Sequence[pb.Sensor], frame_stack: int, *, flatten: bool) -> Box | Dict:
    """Return the space of stacked observations.

    flatten: float32 [frame_stack x frame]. Otherwise a Dict with the dtype and the `stacked_shape` of each sensor.
    """
    if flatten:
        return _make_box(sensors, frame_stack, (-1,), np.float32)
    return Dict(
        {
            sensor.name: _make_box([sensor], frame_stack, stacked_shape(sensor, frame_stack), NUMPY_TYPES[sensor.dtype])
            for sensor in sensors
        }
    )


def stacked_shape(sensor: pb.Sensor, frame_stack: int) -> tuple[int, ...]:
    """Return the shape of a sensor's last frames: [frame_stack, *shape], or just its shape for one frame."""
    return (*([frame_stack] if frame_stack > 1 else []), *sensor.shape)


def _make_box(sensors: Sequence[pb.Sensor], frame_stack: int, shape: tuple[int, ...], dtype: npt.DTypeLike) -> Box:
    low, high = (np.concatenate(ends) for ends in zip(*map(_bounds, sensors), strict=True))
    # Frames before the first of an episode are zero; the newest frame never is one of them.
    low = np.append(np.tile(np.minimum(low, 0.0), frame_stack - 1), low)
    high = np.append(np.tile(np.maximum(high, 0.0), frame_stack - 1), high)
    if np.dtype(dtype).kind in "iu":
        ends = np.iinfo(np.dtype(dtype))
        low, high = np.clip(low, ends.min, ends.max), np.clip(high, ends.min, ends.max)
    return Box(low.reshape(shape).astype(dtype), high.reshape(shape).astype(dtype), dtype=dtype)


def _bounds(sensor: pb.Sensor) -> list[Array]:
    """Return the smallest and the largest value of each element of a sensor, float64 [elements] each."""
    given = (list(sensor.low), list(sensor.high))
    ends = [end or [default] for end, default in zip(given, _RANGES[sensor.dtype], strict=True)]
    return [np.broadcast_to(np.array(end, np.float64), element_count(sensor)) for end in ends]
