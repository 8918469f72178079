"""What a behavior's lanes see, stacked, and how one policy plays in some of them."""

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from gymnasium.spaces import Box, Dict, MultiDiscrete

from joybridge.contract.codec import ActArrays, StepArrays
from joybridge.contract.spec import element_count
from joybridge.contract.tensors import Array
from joybridge.trainer.layouts import CLIP, Layout
from joybridge.v1 import bridge_pb2 as pb

_RANGES = {
    pb.DTYPE_FLOAT32: (-np.inf, np.inf),
    pb.DTYPE_INT32: (-(2.0**31), 2.0**31),
    pb.DTYPE_UINT8: (0.0, 255.0),
    pb.DTYPE_BOOL: (0.0, 1.0),
}

Outcome = tuple[Array, float, bool, bool, dict[str, Any]]  # observation, reward, terminated, truncated, info


class Lanes:
    """One behavior's lanes: their last step and their stacked observations, float32 [lanes, frame_stack × frame].

    now: what the next decisions are based on. last: the same, but of lanes whose episode ended in the step the last
    they saw of it. As in training (trainer/rollout.py), frames of lanes that wait are not pushed.
    """

    step: StepArrays
    now: Array
    last: Array

    def __init__(self, behavior: pb.Behavior, frame_stack: int) -> None:
        self.behavior = behavior
        bounds = [_bounds(sensor) for sensor in behavior.sensors]
        low, high = (np.concatenate(ends) for ends in zip(*bounds, strict=True))
        self.frame = len(low)
        # Older frames may lie before the episode's first and are zero then; the newest never does.
        older = (np.tile(np.minimum(low, 0.0), frame_stack - 1), np.tile(np.maximum(high, 0.0), frame_stack - 1))
        self.space = Box(np.append(older[0], low), np.append(older[1], high), dtype=np.float32)

    def begin(self, step: StepArrays) -> None:
        """Take the first observations of new episodes."""
        frames = _flatten(step.observations)
        self.step = step
        self.now = self.last = np.zeros((len(frames), *self.space.shape), np.float32)
        self.now[:, -self.frame :] = frames

    def push(self, step: StepArrays) -> None:
        """Take what followed a decision."""
        now = np.concatenate([self.now[:, self.frame :], _flatten(step.observations)], axis=1)
        if step.deciding is not None:
            waiting = ~(step.deciding | step.terminated | step.truncated)
            now[waiting] = self.now[waiting]
        self.step, self.now, self.last = step, now, now
        if len(step.ended):
            self.last = now.copy()
            self.last[step.ended, -self.frame :] = _flatten(step.final_observations or [])
            now[step.ended, : -self.frame] = 0.0

    def metrics(self) -> dict[str, Array]:
        """Return the metrics of the episodes that ended, [ended] each, by name."""
        columns = () if self.step.metrics is None else self.step.metrics.T
        return {metric.name: column for metric, column in zip(self.behavior.metrics, columns, strict=False)}


class Player:
    """One policy in some lanes of a behavior: what it is paid, and how its actions reach the device."""

    def __init__(
        self, lanes: Lanes, rows: slice, layout: Layout, reward_weights: Mapping[str, float], where: str
    ) -> None:
        """Make the spaces. where: what errors call the actions. Raises ValueError for an unknown channel."""
        self.lanes, self.rows, self.layout, self.where = lanes, rows, layout, where
        self.behavior = behavior = lanes.behavior
        weights = {channel.name: channel.default_weight for channel in behavior.channels}
        for name in reward_weights:
            if name not in weights:
                raise ValueError(f"reward_weights: {behavior.name} has no {name!r}; it has {', '.join(weights)}")
        self.weights = np.array([reward_weights.get(name, weight) for name, weight in weights.items()])
        self.parts: dict[str, Any] = {}
        if layout.space.continuous:
            self.parts["continuous"] = Box(-1.0, 1.0, (layout.space.continuous,), np.float32)
        if layout.space.branches:
            self.parts["discrete"] = MultiDiscrete(layout.space.branches)
        self.space = Dict(self.parts) if len(self.parts) > 1 else next(iter(self.parts.values()))

    def decides(self) -> bool:
        """Return whether any of the lanes decides next."""
        deciding = self.lanes.step.deciding
        return deciding is None or bool(deciding[self.rows].any())

    def write(self, actions: Any, act: ActArrays) -> None:
        """Write the lanes' actions [rows, …] into the player's part of `act`. Raises ValueError."""
        step, rows = self.lanes.step, self.rows
        masks = None if step.masks is None else [mask[rows] for mask in step.masks]
        continuous = self._part(actions, "continuous").astype(np.float64) * CLIP
        self.layout.write(
            continuous, self._part(actions, "discrete"), ActArrays(act.axes[rows], act.choices[rows]), masks
        )

    def _part(self, actions: Any, kind: str) -> Array:
        """Return the continuous or the discrete actions [rows, width], checked; 0 in lanes that wait."""
        step, where = self.lanes.step, self.where
        rows = len(step.rewards[self.rows])
        if kind not in self.parts:
            return np.zeros((rows, 0), np.int64)
        if len(self.parts) > 1:
            where = f"{where}[{kind!r}]"
            if not isinstance(actions, Mapping) or kind not in actions:
                raise ValueError(f"{where} is missing, expected a dict of continuous and discrete actions")
            actions = actions[kind]
        values: Array = np.asarray(actions)
        space = self.parts[kind]
        shape = [rows, *space.shape]
        kinds, wanted = ("iu", "integers") if kind == "discrete" else ("iuf", "numbers")
        if list(values.shape) != shape or values.dtype.kind not in kinds:
            raise ValueError(f"{where}: {values.dtype} of shape {list(values.shape)}, expected {wanted} of {shape}")
        if step.deciding is not None:
            values = np.where(step.deciding[self.rows, None], values, 0)
        wrong = (values < 0) | (values >= space.nvec) if kind == "discrete" else ~np.isfinite(values)
        if wrong.any():
            row, column = np.argwhere(wrong)[0].tolist()
            wanted = f"0..{space.nvec[column] - 1}" if kind == "discrete" else "a finite number"
            raise ValueError(f"{where}: {values[row, column]} at [{row}, {column}], expected {wanted}")
        return values

    def rewards(self) -> Array:
        """Return the weighted sum of the channels, float64 [rows]."""
        rewards: Array = self.lanes.step.rewards[self.rows] @ self.weights
        return rewards

    def infos(self) -> dict[str, Array]:
        """Return what there is to know for the next decision, [rows, …] by name."""
        step, rows = self.lanes.step, self.rows
        infos: dict[str, Array] = {}
        if step.masks is not None and self.layout.discrete:
            masks = self.layout.masks([mask[rows] for mask in step.masks])
            infos["action_mask"] = np.concatenate(masks, axis=1)
        if step.deciding is not None:
            infos["deciding"] = step.deciding[rows].copy()
        return infos

    # What follows is for players of one lane.

    def info(self) -> dict[str, Any]:
        """Return what there is to know for the lane's next decision."""
        info: dict[str, Any] = {name: rows[0] for name, rows in self.infos().items()}
        if "action_mask" in info:
            ends = np.cumsum(self.layout.space.branches)[:-1]
            masks = tuple(np.split(info["action_mask"].astype(np.int8), ends))
            info["action_mask"] = {"continuous": None, "discrete": masks} if len(self.parts) > 1 else masks
        return info

    def first(self) -> tuple[Array, dict[str, Any]]:
        """Return the observation and the info at the beginning of an episode."""
        return self.lanes.now[self.rows][0].copy(), self.info()

    def outcome(self) -> Outcome:
        """Return what followed the lane's decision: the last of its episode where that ended."""
        step, lane = self.lanes.step, self.rows.start or 0
        terminated, truncated = bool(step.terminated[lane]), bool(step.truncated[lane])
        info = self.info()
        if terminated or truncated:
            row = int(np.searchsorted(step.ended, lane))
            info = {name: float(column[row]) for name, column in self.lanes.metrics().items()}
        return self.lanes.last[lane].copy(), float(self.rewards()[0]), terminated, truncated, info


def _bounds(sensor: pb.Sensor) -> list[Array]:
    """Return the smallest and the largest value of each element of a sensor, float32 [elements] each."""
    given = (list(sensor.low), list(sensor.high))
    ends = [end or [default] for end, default in zip(given, _RANGES[sensor.dtype], strict=True)]
    return [np.broadcast_to(np.array(end, np.float32), element_count(sensor)) for end in ends]


def _flatten(observations: Iterable[Array]) -> Array:
    """Return sensors side by side, float32 [rows, elements]."""
    return np.concatenate([o.reshape(len(o), -1) for o in observations], axis=1, dtype=np.float32)
