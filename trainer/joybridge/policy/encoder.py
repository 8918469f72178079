"""Observations and rewards as a policy gets them: sensors side by side, frames stacked, channels weighted.

Training, playing and the Gymnasium environments use this code, so a policy sees the same numbers everywhere. A frame
is the chosen sensors side by side, float32. An observation is the last `frame_stack` frames, oldest first, zeros
before the first frame of an episode. Frames of lanes that wait are not pushed.
"""

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
import numpy.typing as npt

from joybridge.config.errors import ConfigError
from joybridge.contract.codec import StepArrays
from joybridge.contract.limits import element_count
from joybridge.contract.tensors import Array
from joybridge.v1 import bridge_pb2 as pb


class ObservationEncoder:
    """Turns the step of a behavior into the frames and rewards of one policy."""

    def __init__(
        self, name: str, behavior: pb.Behavior, sensors: Sequence[str] | None, reward_weights: Mapping[str, float]
    ) -> None:
        """Choose sensors (None: all) and the weights of reward channels where they differ from the defaults.

        name: of the policy, for errors. Raises ConfigError for a sensor or channel that the game does not have.
        """
        known = [sensor.name for sensor in behavior.sensors]
        channels = [channel.name for channel in behavior.channels]
        chosen = known if sensors is None else sensors
        _require_known(f"{name}: sensors", chosen, known)
        _require_known(f"{name}: reward_weights", reward_weights, channels)
        self.sensors = [behavior.sensors[known.index(sensor)] for sensor in chosen]
        self.size = sum(element_count(sensor) for sensor in self.sensors)
        self._columns = [known.index(sensor) for sensor in chosen]
        weights = {channel.name: channel.default_weight for channel in behavior.channels} | dict(reward_weights)
        self._weights = np.array([weights[channel] for channel in channels], np.float32)

    def frames(self, observations: Sequence[Array]) -> Array:
        """Return the chosen sensors side by side, float32 [rows, size]."""
        rows = len(observations[0])
        return np.concatenate([observations[i].reshape(rows, -1) for i in self._columns], axis=1, dtype=np.float32)

    def rewards(self, step: StepArrays) -> Array:
        """Return the weighted sum of the reward channels, float32 [lanes]."""
        return step.rewards @ self._weights


def push_frames(now: Array, frames: Array, step: StepArrays, after: Array) -> None:
    """Write the observations that follow `now`, both [lanes, frame_stack x frame], into `after`.

    frames [lanes, frame]: the newest, which for lanes that have ended is the first of the next episode.
    """
    size = frames.shape[1]
    after[:, :-size] = now[:, size:]
    after[:, -size:] = frames
    after[step.ended, :-size] = 0.0
    if step.deciding is not None:
        waiting = ~(step.deciding | step.terminated | step.truncated)
        after[waiting] = now[waiting]


def final_observations(now: Array, frames: Array, step: StepArrays) -> Array:
    """Return the last observations of the episodes that ended, [ended, frame_stack x frame].

    frames [ended, frame]: the last of each episode.
    """
    return np.concatenate([now[step.ended, frames.shape[1] :], frames], axis=1)


class FrameStack:
    """The present observations of some lanes, `now`, [lanes, frame_stack x frame]."""

    def __init__(self, lanes: int, frame: int, frame_stack: int, dtype: npt.DTypeLike = np.float32) -> None:
        """Begin with zeros. frame: numbers per frame."""
        self.now = np.zeros((lanes, frame * frame_stack), dtype)
        self._spare = np.zeros_like(self.now)
        self._frame = frame

    def begin(self, frames: Array) -> None:
        """Begin new episodes in all lanes with their first frames [lanes, frame]."""
        self.now[:, : -self._frame] = 0.0
        self.now[:, -self._frame :] = frames

    def push(self, frames: Array, step: StepArrays) -> None:
        """Push the newest frames [lanes, frame]."""
        push_frames(self.now, frames, step, self._spare)
        self.now, self._spare = self._spare, self.now


def _require_known(where: str, names: Iterable[str], known: Sequence[str]) -> None:
    for name in names:
        if name not in known:
            raise ConfigError(f"{where}: the game has no {name!r}; it has {', '.join(known)}")
