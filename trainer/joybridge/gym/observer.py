"""What a policy in an environment observes: its sensors flattened side by side, or each in its own shape."""

from collections.abc import Sequence
from typing import Any

from joybridge.contract.codec import StepArrays
from joybridge.contract.limits import element_count
from joybridge.contract.tensors import NUMPY_TYPES, Array
from joybridge.policy.encoder import FrameStack, ObservationEncoder, final_observations
from joybridge.policy.observation_space import make_observation_space, stacked_shape
from joybridge.v1 import bridge_pb2 as pb

FLAT = ""  # the only name if sensors are flattened; sensors have longer ones


class Observer:
    """The last frames of some lanes. A batch of observations is an array, or a dict of arrays by sensor."""

    def __init__(
        self, encoder: ObservationEncoder, behavior: pb.Behavior, lanes: int, frame_stack: int, *, flatten: bool
    ) -> None:
        """Make the space and begin with zeros. encoder: of the sensors to observe, which are those of `behavior`."""
        self.space = make_observation_space(encoder.sensors, frame_stack, flatten=flatten)
        self._encoder, self._flatten = encoder, flatten
        if flatten:
            self._stacks = {FLAT: FrameStack(lanes, encoder.size, frame_stack)}
            return
        names = [sensor.name for sensor in behavior.sensors]
        self._columns = {sensor.name: names.index(sensor.name) for sensor in encoder.sensors}
        self._shapes = {sensor.name: stacked_shape(sensor, frame_stack) for sensor in encoder.sensors}
        self._stacks = {
            sensor.name: FrameStack(lanes, element_count(sensor), frame_stack, NUMPY_TYPES[sensor.dtype])
            for sensor in encoder.sensors
        }

    def begin(self, step: StepArrays) -> None:
        """Take the first timestep of new episodes."""
        for name, frames in self._frames(step.observations).items():
            self._stacks[name].begin(frames)

    def push(self, step: StepArrays) -> Any:
        """Take the timestep that followed a decision; return the last observations of the episodes that ended in it."""
        final = None
        if len(step.ended):
            last = self._frames(step.final_observations or [])
            final = self._shaped(
                {name: final_observations(stack.now, last[name], step) for name, stack in self._stacks.items()}
            )
        for name, frames in self._frames(step.observations).items():
            self._stacks[name].push(frames, step)
        return final

    def now(self) -> Any:
        """Return a copy of the observations that the next decisions are based on."""
        return self._shaped({name: stack.now.copy() for name, stack in self._stacks.items()})

    def _frames(self, observations: Sequence[Array]) -> dict[str, Array]:
        """Return the newest frames, [rows, numbers] each."""
        if self._flatten:
            return {FLAT: self._encoder.frames(observations)}
        return {name: observations[i].reshape(len(observations[i]), -1) for name, i in self._columns.items()}

    def _shaped(self, stacked: dict[str, Array]) -> Any:
        if self._flatten:
            return stacked[FLAT]
        return {name: rows.reshape(len(rows), *self._shapes[name]) for name, rows in stacked.items()}


def one_row(batch: Any, row: int) -> Any:
    """Return the observation in one row of a batch."""
    return {name: rows[row] for name, rows in batch.items()} if isinstance(batch, dict) else batch[row]
