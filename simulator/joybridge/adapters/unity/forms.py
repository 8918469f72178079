"""What a behavior of a player observes and does, as parts of a spec.

    rank 1, rank 2       a sensor of this shape, float32
    rank 3               an image [height, width, channels]; uint8 if the player sends PNG, otherwise float32
    continuous actions   axes -1..1
    discrete actions     branches; one with a single choice is no branch

Observations are as the player sends them: stacked ones stay stacked. A reward has two channels: the agent's own, and
what its group is given.
"""

from collections.abc import Sequence
from math import prod

import numpy as np

from joybridge.adapters.settings import AdapterError
from joybridge.contract.limits import MAX_CHOICES, MAX_ELEMENTS, MAX_ENTRIES, MAX_NAME
from joybridge.contract.text import printable
from joybridge.mlagents import communicator_pb2 as ml
from joybridge.simulator import axis, behavior, branch, channel, sensor
from joybridge.simulator.batched_game import GameError
from joybridge.v1 import bridge_pb2 as pb

CHANNELS = [channel("reward"), channel("group_reward", description="what the group of the agent is given")]


class SensorForm:
    """One observation: how it is sent, and its sensor."""

    def __init__(self, observation: ml.Observation, index: int, where: str) -> None:
        """Read the first observation of an agent. Raises AdapterError for what is no sensor."""
        self.shape = tuple(observation.shape)  # as it is sent; channels first
        self.where = f"{where}: observation {index}"
        if not 1 <= len(self.shape) <= 3 or min(self.shape) < 1 or prod(self.shape) > MAX_ELEMENTS:
            raise AdapterError(
                f"{self.where} has shape {list(self.shape)[:9]}, expected 1 to 3 sizes and at most "
                f"{MAX_ELEMENTS} values"
            )
        self.image = len(self.shape) == 3
        self.png = self.image and observation.compression == ml.PNG
        self.mapping = tuple(observation.channel_mapping)
        self.dtype = np.dtype(np.uint8 if self.png else "<f4")
        self.name = printable(observation.name)[:MAX_NAME] or f"observation_{index}"

    def sensor(self) -> pb.Sensor:
        """Return the sensor."""
        channels, height, width = self.shape if self.image else (0, 0, 0)
        return sensor(self.name, (height, width, channels) if self.image else self.shape, dtype=self.dtype)


class BehaviorForm:
    """One behavior of the players."""

    def __init__(self, parameters: ml.BehaviorParameters, first: ml.Agent, agents: int, metrics: Sequence[str]) -> None:
        """Read what a player says about a behavior, and its first agent. Raises AdapterError.

        agents: per arena. metrics: names of statistics; BEHAVIOR/NAME is that of one behavior.
        """
        self.name, self.agents = parameters.name, agents
        where = f"behavior {self.name!r}"
        if not 1 <= len(self.name) <= MAX_NAME or printable(self.name) != self.name:
            raise AdapterError(f"{where}: expected a printable name of 1 to {MAX_NAME} characters")
        self.actions = parameters.action_spec
        self.sizes = list(self.actions.branch_sizes)
        self.branches = [index for index, size in enumerate(self.sizes) if size > 1]  # those that are branches
        self._check_actions(where)
        if not first.observations or len(first.observations) > MAX_ENTRIES:
            raise AdapterError(f"{where} has {len(first.observations)} observations, expected 1 to {MAX_ENTRIES}")
        self.sensors = [SensorForm(one, index, where) for index, one in enumerate(first.observations)]
        if sum(prod(one.shape) for one in self.sensors) > MAX_ELEMENTS:
            raise AdapterError(f"{where} observes more than {MAX_ELEMENTS} values")
        _rename(self.sensors)
        own = [key for key in metrics if "/" not in key or key.startswith(f"{self.name}/")]
        self.metrics = {key.removeprefix(f"{self.name}/"): key for key in own}  # name: name of the statistic

    def behavior(self) -> pb.Behavior:
        """Return its part of the spec."""
        return behavior(
            self.name,
            sensors=[one.sensor() for one in self.sensors],
            axes=[axis(f"continuous_{index}") for index in range(self.actions.continuous_actions)],
            branches=[
                branch(f"discrete_{index}", [str(choice) for choice in range(self.sizes[index])])
                for index in self.branches
            ],
            channels=CHANNELS,
            metrics=list(self.metrics),
            agents=self.agents,
        )

    def _check_actions(self, where: str) -> None:
        continuous, discrete = self.actions.continuous_actions, self.actions.discrete_actions
        if continuous == discrete == 0:
            raise AdapterError(
                f"{where} has no actions; an agent without any is no player, and packages of ML-Agents before 2.0 "
                "announce theirs in another way: update com.unity.ml-agents"
            )
        if not continuous and not self.branches:
            raise AdapterError(f"{where} has a single choice only: there is nothing to decide")


def check_actions(parameters: ml.BehaviorParameters) -> None:
    """Raise GameError for actions of a behavior that contradict themselves, or are too many."""
    spec, where = parameters.action_spec, f"behavior {parameters.name!r}"
    continuous, discrete, sizes = spec.continuous_actions, spec.discrete_actions, list(spec.branch_sizes)
    if not 0 <= continuous <= MAX_ENTRIES or discrete != len(sizes) or discrete > MAX_ENTRIES:
        raise GameError(
            f"{where} has {continuous} continuous and {discrete} discrete actions with {len(sizes)} sizes, expected "
            f"at most {MAX_ENTRIES} of each, and a size for each branch"
        )
    if sizes and not (min(sizes) >= 1 and max(sizes) <= MAX_CHOICES):
        raise GameError(f"{where} has branches of {sizes} choices, expected 1 to {MAX_CHOICES}")


def _rename(sensors: Sequence[SensorForm]) -> None:
    """Number the names that occur more than once, or that are too long, so that all differ."""
    names = [one.name for one in sensors]
    for index, one in enumerate(sensors):
        if names.count(one.name) > 1 or len(one.name) > MAX_NAME:
            short, number = one.name[: MAX_NAME - 10], index
            while f"{short}_{number}" in names:
                number += len(names)
            one.name = f"{short}_{number}"
