"""What a person's hand does to actions on their way from a policy to the device: it is late, slow and not exact.

It also moves the pointer where policies do not place it (`pointer: velocity`), since it knows where that is.

The limits are keys of the configuration, see `HandConfig`. They belong to the world in which a policy plays: a
policy learns from what it chose, and the game gets what its hand makes of that.
"""

from collections.abc import Sequence

import numpy as np

from joybridge.config.config import Config, HandConfig
from joybridge.config.errors import ConfigError
from joybridge.contract.codec import ActArrays, StepArrays, lane_count
from joybridge.contract.tensors import Array
from joybridge.layouts import make_acts
from joybridge.v1 import bridge_pb2 as pb

HANDS = 2**63  # plus the index of the behavior: the second word of the key of its noise


class Hand:
    """The hands of all agents of one behavior in one group of arenas."""

    def __init__(
        self,
        lessons: Sequence[HandConfig],
        device: pb.Device,
        rest: ActArrays,
        noise_key: tuple[int, int],
        first_lane: int,
        speeds: Array | None = None,
    ) -> None:
        """Begin at rest, with the limits of the first lesson.

        first_lane: of the group, so that noise does not depend on how arenas are grouped.
        speeds: how far axes are moved in a decision, see `pointer_speeds`; None: all are placed. Those that are
        moved rest in the middle of their range.
        """
        self._rest, self._key, self._first_lane = rest, noise_key, first_lane
        self._low = np.array([axis.low for axis in device.axes], np.float32)
        self._high = np.array([axis.high for axis in device.axes], np.float32)
        self._middle = (self._low + self._high) / 2
        self._speeds = np.zeros(len(device.axes), np.float32) if speeds is None else speeds
        self._moves = self._speeds > 0
        rest.axes[:, self._moves] = self._middle[self._moves]
        length = max(limits.delay for limits in lessons) + 1
        self._axes = np.tile(rest.axes, (length, 1, 1))  # that were chosen, oldest first
        self._choices = np.tile(rest.choices, (length, 1, 1))
        self._last = ActArrays(rest.axes.copy(), rest.choices.copy())  # that the device got, without noise
        self._kept = np.full(rest.choices.shape, lessons[0].hold)  # decisions since the last change of a choice
        self._decisions = np.array(0)
        self.limit(lessons[0])

    def limit(self, limits: HandConfig) -> None:
        """Take other limits, of one of the lessons, from the next decision on."""
        self.limits, rest = limits, self._rest.axes
        self._least = np.clip(rest + limits.reach * (self._low - rest), self._low, self._high)
        self._most = np.clip(rest + limits.reach * (self._high - rest), self._low, self._high)

    def apply(self, step: StepArrays, act: ActArrays) -> None:
        """Turn the actions that were chosen for a step into those that the device gets, in place.

        The hand of a lane that waits stays as it is: nothing was chosen there, whatever the action says.
        """
        decides = step.decides[:, None]
        for queue, chosen in ((self._axes, act.axes), (self._choices, act.choices)):
            queue[:-1] = np.where(decides, queue[1:], queue[:-1])
            queue[-1] = np.where(decides, chosen, queue[-1])
        due = -1 - self.limits.delay
        act.choices[:] = self._held(self._choices[due], step.masks, decides)
        act.axes[:] = self._moved(self._axes[due], decides)
        self._decisions += 1

    def store(self, step: StepArrays) -> None:
        """Go back to rest in lanes whose episodes are new.

        When the step comes, not with the next action: a session that continues from a snapshot no longer tells.
        """
        lanes = step.ends
        self._axes[:, lanes], self._choices[:, lanes] = self._rest.axes[lanes], self._rest.choices[lanes]
        self._last.axes[lanes], self._last.choices[lanes] = self._rest.axes[lanes], self._rest.choices[lanes]
        self._kept[lanes] = self.limits.hold

    def _held(self, wanted: Array, masks: Sequence[Array] | None, decides: Array) -> Array:
        """Return the choices of the device: the last ones until they may change, or the first that are allowed."""
        last = self._last.choices
        choices = np.where(self._kept >= self.limits.hold, wanted, last)
        for branch, mask in enumerate(masks or ()):
            allowed = mask[np.arange(len(mask)), choices[:, branch]]
            choices[:, branch] = np.where(allowed, choices[:, branch], mask.argmax(axis=1))
        self._kept = np.where(decides, np.where(choices == last, self._kept + 1, 1), self._kept)
        last[:] = np.where(decides, choices, last)
        return choices

    def _moved(self, wanted: Array, decides: Array) -> Array:
        """Return the axes of the device: within reach, not far from the last ones, and not exact.

        Where a policy moves the pointer, the middle of an axis is to stay, and its ends are full speed.
        Noise in proportion to the command is that of human movements (Harris and Wolpert, 1998).
        """
        last, change = self._last.axes, self.limits.change * (self._high - self._low)
        if self._moves.any():
            wanted = np.where(self._moves, last + 2 * self._speeds * (wanted - self._middle), wanted)
        moved = np.clip(np.clip(wanted, self._least, self._most), last - change, last + change)
        last[:] = np.where(decides, moved, last)
        if not self.limits.noise:
            return last
        rng = np.random.Generator(np.random.Philox(key=self._key, counter=[0, int(self._decisions), 0, 0]))
        normal = rng.standard_normal((self._first_lane + len(last), last.shape[1]), np.float32)[self._first_lane :]
        return np.clip(last + self.limits.noise * (last - self._rest.axes) * normal, self._low, self._high)

    def state(self) -> dict[str, Array]:
        """Return copies of everything that fixes what follows, for a checkpoint."""
        return {name: array.copy() for name, array in self._arrays().items()}

    def load(self, state: dict[str, Array]) -> None:
        """Take back what `state` returned. Raises KeyError and ValueError where it does not fit."""
        for name, array in self._arrays().items():
            array[...] = state[name]

    def _arrays(self) -> dict[str, Array]:
        return {
            "axes": self._axes,
            "choices": self._choices,
            "last_axes": self._last.axes,
            "last_choices": self._last.choices,
            "kept": self._kept,
            "decisions": self._decisions,
        }


def make_hands(config: Config, spec: pb.GameSpec, first: int, end: int, seed: int) -> list[Hand]:
    """Return the hands of a group of arenas, `first` to before `end`: one per behavior, none if nothing is limited.

    seed: of the noise.
    """
    lessons = config.hands
    if all(limits == HandConfig() for limits in lessons) and config.pointer != "velocity":
        return []
    return [
        Hand(lessons, behavior.device, rest, (seed, HANDS + index), lane_count(behavior, first), speeds)
        for index, (behavior, rest, speeds) in enumerate(
            zip(spec.behaviors, make_acts(spec, end - first), pointer_speeds(config, spec), strict=True)
        )
    ]


def pointer_speeds(config: Config, spec: pb.GameSpec) -> list[Array]:
    """Return how far policies move each axis of each behavior in a decision, as a share of its range; 0: they place it.

    They move the axes that say that they are positions. Where no axis of the game says what it is, they move all that
    always count. Raises ConfigError if the game has none, or if pointers are to be placed that the game moves.
    """
    axes = [axis for behavior in spec.behaviors for axis in behavior.device.axes]
    said = any(axis.kind for axis in axes)
    if config.pointer == "position" and (moves := [axis for axis in axes if axis.kind == pb.AXIS_KIND_VELOCITY]):
        raise ConfigError(
            f"pointer: {spec.name} moves its pointer by axis {moves[0].name!r} and does not say where it is, so no "
            "policy can place it; leave `pointer` out, or give the game axes of kind position"
        )
    speed = config.pointer_speed if config.pointer == "velocity" else 0.0
    speeds = [
        np.array(
            [
                speed if (axis.kind == pb.AXIS_KIND_POSITION if said else not axis.HasField("only_with")) else 0.0
                for axis in behavior.device.axes
            ],
            np.float32,
        )
        for behavior in spec.behaviors
    ]
    if config.pointer == "velocity" and not any(each.any() for each in speeds):
        raise ConfigError(f"pointer: {spec.name} has no axis that places a pointer, so none can be moved; leave it out")
    return speeds
