"""Observations and rewards as a policy gets them: sensors side by side, frames stacked, channels weighted.

Training, playing and the Gymnasium environments use this code, so a policy sees the same everywhere. A frame is the
chosen sensors but images side by side, float32; images keep their form. An observation is the last `frame_stack` frames
and pictures, oldest first, zeros before the first of an episode. Those of lanes that wait are not pushed.
"""

import math
from collections.abc import Iterable, Mapping, Sequence

import numpy as np
import numpy.typing as npt

from joybridge.config.errors import ConfigError
from joybridge.contract.codec import StepArrays
from joybridge.contract.limits import element_count
from joybridge.contract.tensors import Array
from joybridge.ppo.images import find_images
from joybridge.ppo.observation import Observation
from joybridge.v1 import bridge_pb2 as pb


class ObservationEncoder:
    """Turns the step of a behavior into the frames and rewards of one policy."""

    def __init__(
        self,
        name: str,
        behavior: pb.Behavior,
        sensors: Sequence[str] | None,
        reward_weights: Mapping[str, float],
        image_encoder: str = "none",
    ) -> None:
        """Choose sensors (None: all) and the weights of reward channels where they differ from the defaults.

        name: of the policy, for errors. image_encoder: see `find_images`; with "none", images are plain numbers. Raises
        ConfigError for a sensor or channel that the game does not have.
        """
        known = [sensor.name for sensor in behavior.sensors]
        channels = [channel.name for channel in behavior.channels]
        chosen = known if sensors is None else sensors
        _require_known(f"{name}: sensors", chosen, known)
        _require_known(f"{name}: reward_weights", reward_weights, channels)
        self.sensors = [behavior.sensors[known.index(sensor)] for sensor in chosen]
        self.images = find_images(name, image_encoder, self.sensors)
        self.numbers = [sensor for sensor in self.sensors if sensor.name not in self.images]
        self.size = sum(element_count(sensor) for sensor in self.numbers)
        self._columns = [known.index(sensor.name) for sensor in self.numbers]
        self._pictures = [(known.index(name), image) for name, image in self.images.items()]
        weights = {channel.name: channel.default_weight for channel in behavior.channels} | dict(reward_weights)
        self.weights = np.array([weights[channel] for channel in channels], np.float32)

    def frames(self, observations: Sequence[Array]) -> Array:
        """Return the chosen sensors but images side by side, float32 [rows, size]."""
        rows = len(observations[0])
        if not self._columns:
            return np.zeros((rows, 0), np.float32)
        return np.concatenate([observations[i].reshape(rows, -1) for i in self._columns], axis=1, dtype=np.float32)

    def pictures(self, observations: Sequence[Array]) -> tuple[Array, ...]:
        """Return the images, uint8 [rows, height, width, channels] each."""
        return tuple(observations[column].reshape(-1, *image.shape) for column, image in self._pictures)

    def rewards(self, step: StepArrays) -> Array:
        """Return the weighted sum of the reward channels, float32 [lanes]."""
        return step.rewards @ self.weights

    def penalties(self, step: StepArrays) -> Array:
        """Return the sum of the weighted channels that are negative, float32 [lanes]."""
        summed: Array = np.minimum(step.rewards * self.weights, 0).sum(axis=1, dtype=np.float32)
        return summed


def push_frames(now: Array, frames: Array, step: StepArrays, after: Array) -> None:
    """Write the observations that follow `now`, both [lanes, frame_stack x frame], into `after`.

    frames [lanes, frame]: the newest, which for lanes that have ended is the first of the next episode.
    """
    size = frames.shape[1]
    old = now.shape[1] - size
    after[:, :old] = now[:, size:]
    after[:, old:] = frames
    after[step.ended, :old] = 0
    if step.deciding is not None:
        waiting = ~(step.deciding | step.ends)
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
        self.now[:, : self.now.shape[1] - self._frame] = 0
        self.now[:, self.now.shape[1] - self._frame :] = frames

    def push(self, frames: Array, step: StepArrays, held: Array | None = None) -> None:
        """Push the newest frames [lanes, frame]. held: the numbers of the lanes that they are of; None: of all."""
        if held is not None:
            after = np.empty_like(self.now, shape=(len(held), self.now.shape[1]))
            push_frames(self.now[held], frames, step, after)
            self.now[held] = after
            return
        push_frames(self.now, frames, step, self._spare)
        self.now, self._spare = self._spare, self.now


class Stacks:
    """The present observations of some lanes while a policy plays: numbers, and the last pictures of each image."""

    def __init__(self, encoder: ObservationEncoder, lanes: int, frame_stack: int) -> None:
        """Begin with zeros."""
        self._numbers = FrameStack(lanes, encoder.size, frame_stack)
        self._shapes = [(frame_stack, *image.shape) for image in encoder.images.values()]
        self._images = [FrameStack(lanes, math.prod(shape[1:]), frame_stack, np.uint8) for shape in self._shapes]

    @property
    def now(self) -> Observation:
        """The observations that the next decisions are based on."""
        images = (one.now.reshape(-1, *shape) for one, shape in zip(self._images, self._shapes, strict=True))
        return Observation(self._numbers.now, tuple(images))

    def begin(self, seen: Observation) -> None:
        """Begin new episodes in all lanes with what they see first: frames, and one picture of each image."""
        self._numbers.begin(seen.numbers)
        for stack, pictures in zip(self._images, seen.images, strict=True):
            stack.begin(pictures.reshape(len(pictures), -1))

    def push(self, seen: Observation, step: StepArrays, held: Array | None = None) -> None:
        """Push what lanes see now. held: their numbers; None: all lanes."""
        self._numbers.push(seen.numbers, step, held)
        for stack, pictures in zip(self._images, seen.images, strict=True):
            stack.push(pictures.reshape(len(pictures), -1), step, held)

    def load(self, observations: Observation, held: Array) -> None:
        """Put what the next decisions of some lanes are based on."""
        self._numbers.now[held] = observations.numbers
        for stack, images in zip(self._images, observations.images, strict=True):
            stack.now[held] = images.reshape(len(images), -1)


def _require_known(where: str, names: Iterable[str], known: Sequence[str]) -> None:
    for name in names:
        if name not in known:
            raise ConfigError(f"{where}: the game has no {name!r}; it has {', '.join(known)}")
