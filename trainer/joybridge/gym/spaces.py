"""Observation and action spaces of a policy, and action masks in the form that sampling needs."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from gymnasium.spaces import Box, Dict, MultiDiscrete

from joybridge.contract.limits import element_count
from joybridge.contract.tensors import Array
from joybridge.trainer.layouts import ActionSpace
from joybridge.v1 import bridge_pb2 as pb

_RANGES = {
    pb.DTYPE_FLOAT32: (-np.inf, np.inf),
    pb.DTYPE_INT32: (-(2.0**31), 2.0**31),
    pb.DTYPE_UINT8: (0.0, 255.0),
    pb.DTYPE_BOOL: (0.0, 1.0),
}


def make_observation_space(sensors: Sequence[pb.Sensor], frame_stack: int) -> Box:
    """Return the space of stacked observations, float32 [frame_stack x frame]."""
    bounds = [_bounds(sensor) for sensor in sensors]
    low, high = (np.concatenate(ends) for ends in zip(*bounds, strict=True))
    # Frames before the first of an episode are zero; the newest frame never is one of them.
    older = (np.tile(np.minimum(low, 0.0), frame_stack - 1), np.tile(np.maximum(high, 0.0), frame_stack - 1))
    return Box(np.append(older[0], low), np.append(older[1], high), dtype=np.float32)


def _bounds(sensor: pb.Sensor) -> list[Array]:
    """Return the smallest and the largest value of each element of a sensor, float32 [elements] each."""
    given = (list(sensor.low), list(sensor.high))
    ends = [end or [default] for end, default in zip(given, _RANGES[sensor.dtype], strict=True)]
    return [np.broadcast_to(np.array(end, np.float32), element_count(sensor)) for end in ends]


def make_action_spaces(space: ActionSpace) -> dict[str, Box | MultiDiscrete]:
    """Return the spaces of the parts of an action: "continuous", "discrete" or both."""
    parts: dict[str, Box | MultiDiscrete] = {}
    if space.continuous:
        parts["continuous"] = Box(-1.0, 1.0, (space.continuous,), np.float32)
    if space.branches:
        parts["discrete"] = MultiDiscrete(space.branches)
    return parts


def sample_mask(action_space: Box | MultiDiscrete | Dict, mask: Array) -> Any:
    """Return a mask in the form that `action_space.sample` takes.

    action_space: of one agent. mask: bool [choices], an info's "action_mask".

        action = env.action_space.sample(mask=sample_mask(env.action_space, info["action_mask"]))
    """
    discrete = action_space["discrete"] if isinstance(action_space, Dict) else action_space
    branches = tuple(np.split(np.asarray(mask, np.int8), np.cumsum(discrete.nvec)[:-1]))
    return {"continuous": None, "discrete": branches} if isinstance(action_space, Dict) else branches
