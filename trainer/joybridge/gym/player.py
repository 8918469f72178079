"""One policy in an environment: what it observes, which rewards it gets, and how its actions reach the device."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from gymnasium.spaces import Dict

from joybridge.config.errors import ConfigError
from joybridge.contract.codec import ActArrays, StepArrays, lane_count
from joybridge.contract.errors import JoybridgeError
from joybridge.contract.sharding import rows_of
from joybridge.contract.tensors import Array
from joybridge.gym.observer import Observer, one_row
from joybridge.gym.settings import EnvSettings, Seat
from joybridge.gym.spaces import ActionSpaces, make_action_spaces
from joybridge.layouts import CLIP
from joybridge.policy.encoder import ObservationEncoder
from joybridge.v1 import bridge_pb2 as pb

Outcome = tuple[Any, float, bool, bool, dict[str, Any]]  # observation, reward, terminated, truncated, info


class ActionError(JoybridgeError, ValueError):
    """An action that is missing, outside of its space or forbidden. Nothing was played; the environment can go on."""


class EnvPlayer:
    """One policy in all lanes of a behavior, or in one of them.

    step: the last timestep, of this player's lanes only. final: the last observations of the episodes that ended in
    it, a batch with a row for each.
    """

    step: StepArrays
    final: Any

    def __init__(
        self, name: str, seat: Seat, behavior: pb.Behavior, settings: EnvSettings, part_of_actions: str
    ) -> None:
        """Make the spaces.

        name: in errors, and of its sensors and reward weights in the settings. part_of_actions: which part of the
        actions of a step is its, for errors: "" if they are all its, or "['name']".

        Raises ConfigError for an unknown sensor or reward channel, and for images that are to be flattened.
        """
        self.index, self.layout, self.behavior, self._lane = seat.role.behavior, seat.role.layout, behavior, seat.lane
        self._where = f"actions{part_of_actions}"
        self._rows = slice(None) if seat.lane is None else slice(seat.lane, None, behavior.agents_per_arena)
        self._own = np.arange(lane_count(behavior, settings.arenas))[self._rows]
        self.lanes = len(self._own)
        sensors, weights = ((each or {}).get(name) for each in (settings.sensors, settings.reward_weights))
        if sensors is not None and not sensors:
            raise ConfigError(f"{name}: sensors is empty, expected at least one; leave it out to use all")
        for channel, weight in (weights or {}).items():
            if not isinstance(weight, int | float | np.number) or not math.isfinite(weight):
                raise ConfigError(f"{name}: reward_weights[{channel!r}] is {weight!r}, expected a finite number")
        self._encoder = ObservationEncoder(name, behavior, sensors, weights or {})
        images = [sensor.name for sensor in self._encoder.sensors if sensor.HasField("image")]
        if settings.flatten and images:
            raise ConfigError(
                f"{name}: {', '.join(images)} of {behavior.name} would be flattened, which makes four bytes of each "
                "byte of an image; pass flatten=False, or choose sensors that are no images"
            )
        self._observer = Observer(self._encoder, behavior, self.lanes, settings.frame_stack, flatten=settings.flatten)
        self.observation_space = self._observer.space
        self._parts = make_action_spaces(self.layout.space)
        self.action_space: ActionSpaces = (
            Dict(self._parts) if len(self._parts) > 1 else next(iter(self._parts.values()))
        )
        self._forbidden = settings.forbidden

    def begin(self, step: StepArrays) -> None:
        """Take the first timestep of new episodes, of all lanes of the behavior."""
        self.step = step if self._lane is None else rows_of(step, self._own)
        self._observer.begin(self.step)

    def push(self, step: StepArrays) -> None:
        """Take the timestep that followed a decision, of all lanes of the behavior."""
        self.step = step if self._lane is None else rows_of(step, self._own)
        self.final = self._observer.push(self.step)

    def observations(self) -> Any:
        """Return a copy of the observations that the next decisions are based on, a batch with a row for each lane."""
        return self._observer.now()

    def rewards(self) -> Array:
        """Return the weighted sums of the reward channels, float64 [lanes]."""
        return self._encoder.rewards(self.step).astype(np.float64)

    def infos(self) -> dict[str, Array]:
        """Return "action_mask" and "deciding" for the next decisions, bool [lanes, choices] and [lanes]."""
        step, choices = self.step, sum(self.layout.space.branches)
        mask = np.ones((self.lanes, choices), bool)
        if step.masks is not None and choices:
            mask = np.concatenate(self.layout.masks(step.masks), axis=1)
        deciding = step.decides.copy()
        return {"action_mask": mask, "deciding": deciding}

    def metrics(self) -> dict[str, Array]:
        """Return the metrics of the episodes that ended, [ended] each, by name."""
        columns = () if self.step.metrics is None else self.step.metrics.T
        return {metric.name: column for metric, column in zip(self.behavior.metrics, columns, strict=False)}

    def decides(self) -> bool:
        """Return whether any of the lanes decides next."""
        return self.step.deciding is None or bool(self.step.deciding.any())

    def write(self, actions: Any, act: ActArrays) -> None:
        """Write the actions [lanes, ...] into this player's part of `act`. Raises ActionError."""
        continuous = self._part(actions, "continuous").astype(np.float64) * CLIP
        discrete = self._part(actions, "discrete")
        rows = ActArrays(act.axes[self._rows], act.choices[self._rows])
        self.layout.write(continuous, discrete, rows, self.step.masks)
        if self.step.masks is not None:
            self._obey(self.step.masks, rows.choices)

    def _obey(self, masks: Sequence[Array], choices: Array) -> None:
        """Replace choices [lanes, branches] that are forbidden, or raise ActionError."""
        for branch, mask, column in zip(self.behavior.device.branches, masks, choices.T, strict=True):
            forbidden = ~mask[np.arange(len(mask)), column]
            if self.step.deciding is not None:
                forbidden &= self.step.deciding
            if self._forbidden == "first_allowed":
                column[forbidden] = mask[forbidden].argmax(axis=1)
            elif forbidden.any():
                row = int(forbidden.argmax())
                lane = self._own[row]
                raise ActionError(
                    f"{self._where}: branch {branch.name!r} got {branch.choices[column[row]]!r} in lane {lane}, which "
                    "its mask forbids in this step; choose what info['action_mask'] allows, or make the environment "
                    "with forbidden='first_allowed'"
                )

    def _part(self, actions: Any, kind: str) -> Array:
        """Return the continuous or the discrete actions [lanes, width], checked; 0 in lanes that wait."""
        where = self._where
        if kind not in self._parts:
            return np.zeros((self.lanes, 0), np.int64)
        if len(self._parts) > 1:
            where = f"{where}[{kind!r}]"
            if not isinstance(actions, Mapping) or kind not in actions:
                raise ActionError(f"{where} is missing, expected a dict of continuous and discrete actions")
            actions = actions[kind]
        values: Array = np.asarray(actions)
        space = self._parts[kind]
        shape = [self.lanes, *space.shape]
        kinds, wanted = ("iu", "integers") if kind == "discrete" else ("iuf", "numbers")
        if list(values.shape) != shape or values.dtype.kind not in kinds:
            raise ActionError(f"{where}: {values.dtype} of shape {list(values.shape)}, expected {wanted} of {shape}")
        if self.step.deciding is not None:
            values = np.where(self.step.deciding[:, None], values, 0)
        wrong = (values < 0) | (values >= space.nvec) if kind == "discrete" else ~np.isfinite(values)
        if wrong.any():
            row, column = np.argwhere(wrong)[0].tolist()
            wanted = f"0..{space.nvec[column] - 1}" if kind == "discrete" else "a finite number"
            raise ActionError(f"{where}: {values[row, column]} at [{row}, {column}], expected {wanted}")
        return values

    # The methods below are for players of one lane.

    def first(self) -> tuple[Any, dict[str, Any]]:
        """Return the observation and the info at the beginning of an episode."""
        return one_row(self._observer.now(), 0), self._info()

    def outcome(self) -> Outcome:
        """Return what followed the decision; if the episode ended, with its last observation and its metrics."""
        step, info = self.step, self._info()
        if len(step.ended):
            observation = one_row(self.final, 0)
            info |= {name: float(column[0]) for name, column in self.metrics().items()}
        else:
            observation = one_row(self._observer.now(), 0)
        return observation, float(self.rewards()[0]), bool(step.terminated[0]), bool(step.truncated[0]), info

    def _info(self) -> dict[str, Any]:
        """Return the infos of the only lane: the mask is an array, and `deciding` a bool."""
        infos = self.infos()
        return {"action_mask": infos["action_mask"][0], "deciding": bool(infos["deciding"][0])}
