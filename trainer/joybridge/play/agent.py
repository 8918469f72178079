"""Play a trained policy in a program of your own: no simulator, and one observation at a time.

    from joybridge.play.agent import load

    agent = load("runs/catch")
    action = agent.act({"gap": [0.3]})  # {"move": -0.71, "grab": 0}
    agent.begin()  # the next observation is the first of an episode

The run's folder holds all that this needs. Nothing that a run of somebody else names is started, imported or called.
"""

from collections.abc import Mapping, Sequence, Set
from pathlib import Path
from typing import Any

import numpy as np

from joybridge.contract.codec import StepArrays
from joybridge.contract.tensors import NUMPY_TYPES, Array, TensorError
from joybridge.play.playing import Policies
from joybridge.policy.config_fit import find_behavior
from joybridge.run.folder import play_config, run_spec
from joybridge.v1 import bridge_pb2 as pb

__all__ = ["Agent", "load"]


class Agent:
    """One agent of a game, played by the policies of a run, with the hand that they were trained with."""

    def __init__(self, behavior: int, spec: pb.GameSpec, policies: Policies) -> None:
        """Play an agent of a behavior, by its index. spec: with one agent per arena. policies: in one arena."""
        self.behavior, self.timesteps = spec.behaviors[behavior], policies.timesteps
        self._index, self._policies = behavior, policies
        self._steps = [_zeros(one) for one in spec.behaviors]  # those of other behaviors stay as they are
        self._first, self._new = True, True
        names = [sensor.name for sensor in self.behavior.sensors]
        self._seen = {name for player in policies.players for name in player.actor.config.sensors or names}

    def begin(self) -> None:
        """Begin a new episode with the next observation."""
        self._new = True

    def act(
        self,
        observation: Any,
        masks: Mapping[str, Sequence[bool]] | None = None,
        rewards: Mapping[str, float] | None = None,
    ) -> dict[str, float | int]:
        """Return what to do now: a float for each axis and an int for each branch, by name, as `Game.step` takes them.

        observation: the value of each sensor, by name, in the shape of the spec; sensors that the policies do not see
        may be left out. Where there is one sensor, as with a Box of Gymnasium, its value alone will do. masks: the
        allowed choices of branches, by name; those that are left out allow all. rewards: what channels gave since the
        last decision, by name; those that are left out gave 0; only policies with `remember_acts` use them. Call this
        for every decision of the agent, in order, since policies remember what they saw. Raises TensorError for an
        observation, a mask or a reward that the spec does not have.
        """
        device = self.behavior.device
        step = _zeros(self.behavior)
        step.observations = _observations(self.behavior, self._seen, observation)
        step.masks = _masks(device, masks) if masks else None
        step.rewards = _rewards(self.behavior, rewards or {})
        self._steps[self._index] = step
        if self._new:
            step.terminated[:], step.ended = True, np.zeros(1, np.int32)
        if self._first:
            self._policies.begin(self._steps)
        else:
            self._policies.store(self._steps)
        self._first = self._new = False
        act = self._policies.act(self._steps)[self._index]
        axes = {axis.name: float(value) for axis, value in zip(device.axes, act.axes[0], strict=True)}
        return axes | {one.name: int(choice) for one, choice in zip(device.branches, act.choices[0], strict=True)}


def load(
    run: str | Path, behavior: str = "", *, checkpoint: str = "", deterministic: bool = False, seed: int = 1
) -> Agent:
    """Return an agent that a run has trained.

    behavior: its name; needed if the game has several. checkpoint: "best", its timesteps, or "" for the newest.
    deterministic: always take the most probable action. `seed` fixes what is sampled otherwise. Raises ConfigError and
    CheckpointError.
    """
    spec = run_spec(Path(run))
    index = find_behavior(spec, behavior, "load(run, behavior)")
    for one in spec.behaviors:
        one.agents_per_arena = 1
    config = play_config(Path(run), ())
    policies = Policies(Path(run), config, spec, 1, seed, deterministic=deterministic, checkpoint=checkpoint)
    policies.players = [player for player in policies.players if player.actor.behavior == index]
    return Agent(index, spec, policies)


def _zeros(behavior: pb.Behavior) -> StepArrays:
    """Return a step of one lane in which nothing is seen and nothing has happened."""
    seen = [np.zeros((1, *sensor.shape), NUMPY_TYPES[sensor.dtype]) for sensor in behavior.sensors]
    return StepArrays(seen, np.zeros((1, len(behavior.channels)), np.float32), np.zeros(1, bool), np.zeros(1, bool))


def _observations(behavior: pb.Behavior, needed: Set[str], given: Any) -> list[Array]:
    """Return what each sensor shows, [1, *shape], zeros where it is not needed and not given. Raises TensorError."""
    names = [sensor.name for sensor in behavior.sensors]
    if not isinstance(given, Mapping):
        if len(names) > 1:
            wanted = f"expected a dict with the values of {', '.join(names)}"
            raise TensorError(f"observation: got a value of type {type(given).__name__}, {wanted}")
        given = {names[0]: given}
    if not needed <= set(given) <= set(names):
        expected = ", ".join(name for name in names if name in needed)
        raise TensorError(f"observation: got the sensors {', '.join(given) or 'none'}, expected {expected}")
    shown = _zeros(behavior).observations
    for index, sensor in enumerate(behavior.sensors):
        if sensor.name in given:
            what = f"observation: sensor {sensor.name!r}"
            shown[index] = _array(what, given[sensor.name], NUMPY_TYPES[sensor.dtype], sensor.shape)
    return shown


def _masks(device: pb.Device, given: Mapping[str, Sequence[bool]]) -> list[Array]:
    """Return which choices of each branch are allowed, bool [1, choices]. Raises TensorError."""
    names = [branch.name for branch in device.branches]
    if unknown := [name for name in given if name not in names]:
        raise TensorError(f"masks: there is no branch {unknown[0]!r}, expected {', '.join(names) or 'none'}")
    masks = []
    for branch in device.branches:
        count = len(branch.choices)
        mask = _array(f"masks: {branch.name!r}", given.get(branch.name, [True] * count), np.dtype(bool), [count])
        if not mask.any():
            raise TensorError(f"masks: {branch.name!r} allows none of its {count} choices, expected at least one")
        masks.append(mask)
    return masks


def _rewards(behavior: pb.Behavior, given: Mapping[str, float]) -> Array:
    """Return the rewards of all channels, float32 [1, channels]. Raises TensorError."""
    names = [channel.name for channel in behavior.channels]
    if unknown := [name for name in given if name not in names]:
        raise TensorError(f"rewards: there is no channel {unknown[0]!r}, expected {', '.join(names)}")
    return _array("rewards", [given.get(name, 0.0) for name in names], np.dtype(np.float32), [len(names)])


def _array(what: str, value: Any, dtype: Any, shape: Sequence[int]) -> Array:
    """Return a value as an array [1, *shape]. Raises TensorError."""
    try:
        given = np.asarray(value)
        with np.errstate(over="ignore", invalid="ignore"):  # what is too large becomes infinite
            array = given.astype(dtype)
    except (TypeError, ValueError, OverflowError) as error:
        raise TensorError(f"{what} is no {dtype}: {error}") from None
    if array.shape != tuple(shape):
        raise TensorError(f"{what} has shape {list(array.shape)}, expected {list(shape)}")
    if dtype.kind != "f" and not np.array_equal(array, given):
        wrong = given.reshape(-1)[(array != given).reshape(-1).argmax()]
        raise TensorError(f"{what} has {wrong!s} of {given.dtype}, expected values of {dtype}")
    if not np.isfinite(array).all():
        raise TensorError(f"{what} is {array.tolist()}, expected finite numbers")
    return array[None]
