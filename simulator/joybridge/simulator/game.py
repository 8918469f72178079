"""`Game`, which an author subclasses: one arena of a game, with a spec and two methods.

    from joybridge.simulator import Game, behavior, button, sensor, spec, termination, transition

    class Echo(Game):
        name = "echo"
        description = "Press the button while the light is on."

        @classmethod
        def describe(cls, options):
            return spec(cls, [behavior("player", sensors=[sensor("light", [1])], branches=[button("press")])])

        def reset(self):
            self.light = int(self.rng.integers(2))
            return transition({"light": [self.light]})

        def step(self, action):
            reward = float(action["press"] == self.light)
            return termination({"light": [self.light]}, {"reward": reward})

`game_adapter.py` turns a Game into a BatchedGame, which is what the server runs. Each session plays in a thread of its
own, so a game keeps its state in itself: a variable of its module, or the display of pygame, is there once for all.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from joybridge.contract.tensors import Array
from joybridge.v1 import bridge_pb2 as pb

Action = dict[str, float | int]  # by name: the value of each axis and the index of each branch's choice


@dataclass(slots=True)  # not frozen: one is made per agent and decision, and would take five times as long
class TimeStep:
    """What one agent receives after a decision.

    Create it with `transition`, `waiting`, `termination` or `truncation`: they set the three flags consistently.
    """

    observation: Mapping[str, Any]  # sensor name -> array-like of the sensor's shape
    rewards: Mapping[str, float] = field(default_factory=dict)  # channel name -> reward; a missing channel is 0
    masks: Mapping[str, Sequence[bool]] = field(default_factory=dict)  # branch name -> allowed choices; missing: all
    metrics: Mapping[str, float] = field(default_factory=dict)  # metric name -> value, at the end of an episode
    deciding: bool = True  # whether the agent's next action counts
    terminated: bool = False
    truncated: bool = False


def transition(
    observation: Mapping[str, Any],
    rewards: Mapping[str, float] | None = None,
    masks: Mapping[str, Sequence[bool]] | None = None,
) -> TimeStep:
    """Return a timestep after which the episode continues and the agent decides next."""
    return TimeStep(observation, rewards or {}, masks or {})


def waiting(observation: Mapping[str, Any], rewards: Mapping[str, float] | None = None) -> TimeStep:
    """Return a timestep after which the episode continues, but the agent does not decide next.

    Its rewards are added up and delivered when it decides again or the episode ends.
    """
    return TimeStep(observation, rewards or {}, deciding=False)


def termination(
    observation: Mapping[str, Any],
    rewards: Mapping[str, float] | None = None,
    metrics: Mapping[str, float] | None = None,
) -> TimeStep:
    """Return the last timestep of an episode that reached a terminal state: no value is bootstrapped from it."""
    return TimeStep(observation, rewards or {}, metrics=metrics or {}, terminated=True)


def truncation(
    observation: Mapping[str, Any],
    rewards: Mapping[str, float] | None = None,
    metrics: Mapping[str, float] | None = None,
) -> TimeStep:
    """Return the last timestep of an episode that was cut off, as by a time limit: its value is bootstrapped."""
    return TimeStep(observation, rewards or {}, metrics=metrics or {}, truncated=True)


class Game(ABC):
    """One arena of a game.

    With one agent per arena, `reset` returns a TimeStep, and `step` takes an Action and returns a TimeStep. With
    several agents, both use lists with one entry per agent, in the order of the spec's behaviors. The episode ends
    for all agents of an arena in the same step.

    The server sets three attributes before the first `reset`: `rng`, `option` and `parameter`. All randomness must
    come from `rng`, otherwise the same seed does not reproduce the same episodes.
    """

    name: ClassVar[str]
    description: ClassVar[str]
    options: ClassVar[Sequence[pb.Option]] = ()
    version: ClassVar[str] = ""  # of the rules: change it whenever the same seed and actions may give other steps
    in_event_loop: ClassVar[bool] = False  # see BatchedGame

    rng: np.random.Generator  # of this arena alone
    option: Mapping[str, str]  # option name -> chosen value
    parameter: Mapping[str, float]  # parameter name -> value of this arena, which holds until the next `reset`

    @classmethod
    @abstractmethod
    def describe(cls, options: Mapping[str, str]) -> pb.GameSpec:
        """Return the spec for the chosen value of every option. Build it with `spec`."""

    @abstractmethod
    def reset(self) -> TimeStep | list[TimeStep]:
        """Begin an episode and return its first observation."""

    @abstractmethod
    def step(self, action: Any) -> TimeStep | list[TimeStep]:
        """Advance by one decision and return the result. A game with shorter ticks repeats the action itself."""

    def script(self, name: str, agent: int) -> Action:
        """Return what a script does now for an agent that decides. Required if a behavior has scripts.

        agent: its index in the lists of `step`.
        """
        raise NotImplementedError(f"{self.name} has scripts in its spec but no script method")

    def draw(self) -> Array:
        """Return a picture, uint8 [height, width, 3]. Required if the spec has a picture size."""
        raise NotImplementedError(f"{self.name} has a picture size in its spec but no draw method")

    def close(self) -> None:
        """Free what the garbage collection does not, such as processes. Called once, after everything else."""
        return
