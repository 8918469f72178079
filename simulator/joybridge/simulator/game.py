"""What an author of a game subclasses: `Game`, one arena at a time.

A whole game is a spec and two methods:

    class Echo(Game):
        name = "echo"
        description = "Press the button when the light is on."

        @classmethod
        def describe(cls, options):
            return spec(cls, [behavior("player", sensors=[sensor("light", [1])], branches=[button("press")])])

        def reset(self):
            self.light = int(self.rng.integers(2))
            return transition({"light": [self.light]})

        def step(self, action):
            reward = float(action["press"] == self.light)
            return termination({"light": [self.light]}, {"reward": reward})

`arenas.py` runs many of them as one batch; the server cannot tell the difference from a BatchedGame.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from joybridge.contract.tensors import Array
from joybridge.v1 import bridge_pb2 as pb

Action = dict[str, float | int]  # value of each axis and index of each branch's choice, by name


@dataclass(frozen=True)
class Turn:
    """What one agent gets after a decision. Made by the functions below, so its end cannot be contradictory."""

    observation: Mapping[str, Any]  # array-like per sensor
    rewards: Mapping[str, float] = field(default_factory=dict)  # per channel; absent: 0
    masks: Mapping[str, Sequence[bool]] = field(default_factory=dict)  # per branch; absent: all allowed
    metrics: Mapping[str, float] = field(default_factory=dict)  # at the end of an episode
    deciding: bool = True
    terminated: bool = False
    truncated: bool = False


def transition(
    observation: Mapping[str, Any],
    rewards: Mapping[str, float] | None = None,
    masks: Mapping[str, Sequence[bool]] | None = None,
) -> Turn:
    """The episode goes on and the agent decides next."""
    return Turn(observation, rewards or {}, masks or {})


def waiting(observation: Mapping[str, Any], rewards: Mapping[str, float] | None = None) -> Turn:
    """The episode goes on, but the agent does not decide next; its rewards are kept until it does."""
    return Turn(observation, rewards or {}, deciding=False)


def termination(
    observation: Mapping[str, Any],
    rewards: Mapping[str, float] | None = None,
    metrics: Mapping[str, float] | None = None,
) -> Turn:
    """The game is over: there is no future."""
    return Turn(observation, rewards or {}, metrics=metrics or {}, terminated=True)


def truncation(
    observation: Mapping[str, Any],
    rewards: Mapping[str, float] | None = None,
    metrics: Mapping[str, float] | None = None,
) -> Turn:
    """The episode is cut short: the future is merely not seen."""
    return Turn(observation, rewards or {}, metrics=metrics or {}, truncated=True)


class Game(ABC):
    """One arena of a game.

    `rng` is the arena's own generator; a game that draws from anything else is not reproducible. With one
    agent per arena `reset` returns a Turn and `step` takes an Action and returns a Turn; with more, lists of
    them, one per agent, behaviors in the spec's order. All agents of an arena end together.
    """

    name: ClassVar[str]
    description: ClassVar[str]
    options: ClassVar[Sequence[pb.Option]] = ()

    rng: np.random.Generator
    option: Mapping[str, str]  # the choice of every option
    parameter: Mapping[str, float]  # the value of every parameter

    @classmethod
    @abstractmethod
    def describe(cls, options: Mapping[str, str]) -> pb.GameSpec:
        """Return the spec under the given choice of every option; see `spec`."""

    @abstractmethod
    def reset(self) -> Turn | list[Turn]:
        """Begin an episode and return the first observation."""

    @abstractmethod
    def step(self, action: Any) -> Turn | list[Turn]:
        """Play one decision (repeat it yourself if the game's ticks are shorter) and return what came of it."""

    def draw(self) -> Array:
        """Return a picture, uint8 [height, width, 3]; needed where the spec has a picture size."""
        raise NotImplementedError(f"{self.name} has a picture size in its spec but no draw method")


def spec(
    game: type[Game],
    behaviors: Sequence[pb.Behavior],
    *,
    parameters: Sequence[pb.Parameter] = (),
    max_episode_decisions: int = 0,
    tick_seconds: float = 0.0,
    picture: tuple[int, int] | None = None,
) -> pb.GameSpec:
    """Return the spec of a one-arena game; `picture` is (width, height) where it can be drawn."""
    return pb.GameSpec(
        name=game.name,
        description=game.description,
        options=game.options,
        parameters=parameters,
        behaviors=behaviors,
        decision_interval=1,
        tick_seconds=tick_seconds,
        max_episode_decisions=max_episode_decisions,
        max_arenas=1024,
        picture=pb.PictureSize(width=picture[0], height=picture[1]) if picture else None,
    )


def behavior(
    name: str,
    *,
    sensors: Sequence[pb.Sensor],
    axes: Sequence[pb.Axis] = (),
    branches: Sequence[pb.Branch] = (),
    channels: Sequence[pb.RewardChannel] = (),
    metrics: Sequence[str] = (),
    agents: int = 1,
    description: str = "",
) -> pb.Behavior:
    """Return one kind of agent. Without channels it has a single one, "reward"."""
    return pb.Behavior(
        name=name,
        description=description,
        agents_per_arena=agents,
        sensors=sensors,
        device=pb.Device(axes=axes, branches=branches),
        channels=channels or [channel("reward")],
        metrics=[pb.Metric(name=metric) for metric in metrics],
    )


def sensor(
    name: str, shape: Sequence[int], low: float | None = None, high: float | None = None, description: str = ""
) -> pb.Sensor:
    """Return a float32 sensor; bounds hold for every element."""
    lows, highs = [] if low is None else [low], [] if high is None else [high]
    return pb.Sensor(name=name, description=description, dtype=pb.FLOAT32, shape=shape, low=lows, high=highs)


def axis(name: str, low: float = -1.0, high: float = 1.0, description: str = "") -> pb.Axis:
    """Return a continuous action."""
    return pb.Axis(name=name, description=description, low=low, high=high)


def branch(name: str, choices: Sequence[str], description: str = "") -> pb.Branch:
    """Return a discrete action of two or more labelled choices."""
    return pb.Branch(name=name, description=description, choices=choices)


def button(name: str, description: str = "") -> pb.Branch:
    """Return a branch that is a button: 0 released, 1 pressed."""
    return branch(name, ["released", "pressed"], description)


def channel(name: str, default_weight: float = 1.0, description: str = "") -> pb.RewardChannel:
    """Return a reward channel."""
    return pb.RewardChannel(name=name, description=description, default_weight=default_weight)
