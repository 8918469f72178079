"""An environment of Gymnasium as a game with one agent: `joybridge serve --gym CartPole-v1`.

Each episode begins with a seed from the arena's stream. Numbers that the environment takes in the options of `reset`
are parameters of the game if its metadata says between what they lie, and what they are otherwise:

    metadata = {"parameters": {"wind": (0.0, 2.0, 1.0)}}  # low, high, default
"""

from collections.abc import Callable, Mapping
from functools import partial
from importlib.metadata import entry_points
from math import isfinite
from numbers import Real
from typing import Any, ClassVar

import gymnasium
import numpy as np

from joybridge.adapters.environment_game import EnvironmentGame
from joybridge.adapters.rendering import choose_rendering, making, tick_seconds
from joybridge.adapters.settings import MAX_ARENAS, SEEDS, AdapterError, read_settings
from joybridge.adapters.spaces import AgentSpaces
from joybridge.contract.places import environment_name
from joybridge.simulator import Game, TimeStep, behavior, parameter, spec, termination, transition, truncation
from joybridge.v1 import bridge_pb2 as pb


def adapt(text: str) -> type[Game]:
    """Return the game for "ID KEY=VALUE …"; the ID may be "module:ID".

    Raises AdapterError, and whatever the environment raises.
    """
    environment, arguments = read_settings(text)
    _register(environment)
    make = partial(gymnasium.make, environment, disable_env_checker=True)  # the adapter checks what comes back
    arguments, picture = choose_rendering(make, arguments)
    with making(make, arguments) as env:
        spaces = AgentSpaces(env.observation_space, env.action_space)
        parameters = _parameters(env, arguments)
        metrics = _numbers_of(env, spaces, {each.name: each.default_value for each in parameters})
        seconds, limit = tick_seconds(env), env.spec.max_episode_steps or 0
    members = {
        "name": environment_name(environment),
        "description": f"{text}, an environment of Gymnasium.",
        "make": staticmethod(partial(make, **arguments)),
        "spaces": spaces,
        "metrics": metrics,
    }
    game: Any = type("AdaptedGame", (GymnasiumGame,), members)
    game.made = spec(
        game,
        [behavior("agent", sensors=spaces.sensors, axes=spaces.axes, branches=spaces.branches, metrics=metrics)],
        tick_seconds=seconds,
        max_episode_decisions=limit,
        max_arenas=MAX_ARENAS,
        parameters=parameters,
        picture=picture,
    )
    return game  # type: ignore[no-any-return]


def _register(environment: str) -> None:
    """Let the package of an ID "NAMESPACE/NAME" register its environments, as Gymnasium did by itself before 1.0."""
    if ":" not in environment and environment not in gymnasium.registry:
        for point in entry_points(group="gymnasium.envs", name=environment.rpartition("/")[0]):
            point.load()()


class GymnasiumGame(EnvironmentGame):
    """One environment with one agent."""

    spaces: ClassVar[AgentSpaces]
    metrics: ClassVar[list[str]]

    def __init__(self) -> None:
        """Make the environment."""
        super().__init__()
        self.action_masks = _action_masks(self.env)

    def reset(self) -> TimeStep:
        """Begin an episode with the next seed of the arena's stream."""
        seed = int(self.rng.integers(SEEDS))
        with self.display.own():
            observation, info = self.env.reset(seed=seed, **_options(self.parameter))
            seen, masks = self.spaces.observe(observation), self.spaces.masks(observation, info, self.action_masks())
        return transition(seen, masks=masks)

    def step(self, action: Any) -> TimeStep:
        """Advance the environment. Where it is terminated and truncated at once, the episode is terminated."""
        with self.display.own():
            observation, reward, terminated, truncated, info = self.env.step(self.spaces.act(action))
            seen, rewards = self.spaces.observe(observation), {"reward": _reward(reward)}
        if terminated or truncated:
            ended = termination if terminated else truncation
            return ended(seen, rewards, {name: _number(info.get(name)) or 0.0 for name in self.metrics})
        return transition(seen, rewards, self.spaces.masks(observation, info, self.action_masks()))


def _action_masks(env: Any) -> Callable[[], Any]:
    """Return the method `action_masks` of an environment, which by convention returns the mask of its present state."""
    return env.get_wrapper_attr("action_masks") if env.has_wrapper_attr("action_masks") else lambda: None


def _parameters(env: Any, arguments: Mapping[str, Any]) -> list[pb.Parameter]:
    """Return the parameters that the metadata of an environment names.

    arguments: of its constructor. One that is also a parameter is refused, since each `reset` sets the parameter.
    Raises AdapterError.
    """
    named = env.metadata.get("parameters", {})  # a wrapper may have its own
    try:
        parameters = [parameter(name, float(low), float(high), float(own)) for name, (low, high, own) in named.items()]
    except (AttributeError, TypeError, ValueError) as error:
        raise AdapterError(
            f'metadata["parameters"] is {named}, expected {{"NAME": (LOW, HIGH, DEFAULT)}} for options of `reset`'
        ) from error
    for name in sorted(arguments.keys() & named.keys()):
        raise AdapterError(
            f"got the argument {name}={arguments[name]}, and {name} is a parameter, which each `reset` sets; "
            f"give it as parameters.{name}={arguments[name]} where the environment is trained, evaluated or played"
        )
    return parameters


def _options(parameters: Mapping[str, float]) -> dict[str, Any]:
    """Return the argument of `reset` that holds the parameters; none where there are none."""
    return {"options": dict(parameters)} if parameters else {}


def _numbers_of(env: Any, spaces: AgentSpaces, parameters: Mapping[str, float]) -> list[str]:
    """Return the names of the numbers in `info` after one decision, which become metrics of an episode's last step."""
    observation, info = env.reset(seed=0, **_options(parameters))
    masks = spaces.masks(observation, info, _action_masks(env)())
    action = {axis.name: (axis.low + axis.high) / 2 for axis in spaces.axes}
    action |= {branch.name: int(np.argmax(masks.get(branch.name, [True]))) for branch in spaces.branches}
    info = env.step(spaces.act(action))[-1]
    return [name for name, value in info.items() if isinstance(name, str) and _number(value) is not None]


def _reward(reward: Any) -> float:
    """Return a reward as a float, also one in an array of one element. Raises ValueError for what is no number."""
    try:
        return float(np.asarray(reward).item())
    except (TypeError, ValueError) as error:
        raise ValueError(f"the reward is {reward!r}, expected a number") from error


def _number(value: Any) -> float | None:
    """Return a finite number as a float, None for everything else."""
    return float(value) if isinstance(value, Real | np.bool_) and isfinite(value) else None
