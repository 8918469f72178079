"""A multi-agent environment of PettingZoo as a game: `joybridge serve --pettingzoo pettingzoo.classic.tictactoe_v3`.

Agents whose names differ only in a number at the end, and whose spaces are equal, are one behavior. The episode of an
arena lasts until no agent is left. An agent that is not there, or whose turn it is not, waits.
"""

import re
from collections.abc import Collection, Mapping
from importlib import import_module
from typing import Any, ClassVar

import numpy as np
from pettingzoo import AECEnv

from joybridge.adapters.environment_game import EnvironmentGame
from joybridge.adapters.rendering import choose_rendering, making, tick_seconds
from joybridge.adapters.settings import MAX_ARENAS, SEEDS, AdapterError, read_settings
from joybridge.adapters.spaces import AgentSpaces
from joybridge.simulator import Action, Game, TimeStep, behavior, spec, termination, transition, truncation, waiting


def adapt(text: str) -> type[Game]:
    """Return the game for "MODULE KEY=VALUE …" or "MODULE:NAME KEY=VALUE …".

    NAME: a class or function of the module that makes an environment; without it `parallel_env` or `env`.

    Raises AdapterError, and whatever the environment raises.
    """
    place, arguments = read_settings(text)
    name, _, maker = place.partition(":")
    module = import_module(name)
    makers = [maker] if maker else ["parallel_env", "env"]
    make = next((getattr(module, each) for each in makers if hasattr(module, each)), None)
    if make is None:
        raise AdapterError(
            f"the module {name} has no {' or '.join(makers)}; name the class or function that makes an environment, as "
            f"in {name}:MyEnvironment"
        )
    arguments, picture = choose_rendering(make, arguments)
    with making(make, arguments) as env:
        if not getattr(env, "possible_agents", None):
            raise AdapterError(
                "the environment has no possible_agents; joybridge.v1 needs to know how many there may be"
            )
        behaviors, seconds = _behaviors(env), tick_seconds(env)
        kind = TurnsGame if isinstance(env, AECEnv) else ParallelGame
    game: Any = type(
        "AdaptedGame",
        (kind,),
        {
            "name": maker or name.rpartition(".")[2],
            "description": f"{text}, an environment of PettingZoo.",
            "make": staticmethod(lambda: make(**arguments)),
            "spaces": {agent: spaces for agents, spaces in behaviors.values() for agent in agents},
        },
    )
    game.made = spec(
        game,
        [
            behavior(each, sensors=s.sensors, axes=s.axes, branches=s.branches, agents=len(agents))
            for each, (agents, s) in behaviors.items()
        ],
        tick_seconds=seconds,
        max_arenas=MAX_ARENAS,
        picture=picture,
    )
    return game  # type: ignore[no-any-return]


def _behaviors(env: Any) -> dict[str, tuple[list[str], AgentSpaces]]:
    """Return the agents of each behavior, and their spaces, by the name of the behavior."""
    kinds: dict[str, list[str]] = {}
    for agent in env.possible_agents:
        kinds.setdefault(re.sub(r"_?\d+$", "", agent) or agent, []).append(agent)
    behaviors = {}
    for kind, agents in kinds.items():
        pairs = [(env.observation_space(agent), env.action_space(agent)) for agent in agents]
        if all(pair == pairs[0] for pair in pairs):
            behaviors[kind] = (agents, AgentSpaces(*pairs[0]))
        else:
            behaviors |= {agent: ([agent], AgentSpaces(*pair)) for agent, pair in zip(agents, pairs, strict=True)}
    return behaviors


class PettingZooGame(EnvironmentGame):
    """One environment with several agents, in the order of `spaces`."""

    spaces: ClassVar[dict[str, AgentSpaces]]  # of every possible agent

    def reset(self) -> list[TimeStep]:
        """Begin an episode with the next seed of the arena's stream."""
        self.terminated: dict[str, bool] = {}  # the agents that have ended: terminated, or else truncated
        # An agent that is not there yet sees zeros.
        self.seen: dict[str, Mapping[str, Any]] = {
            agent: {one.name: np.zeros(one.shape) for one in spaces.sensors} for agent, spaces in self.spaces.items()
        }
        with self.display.own():
            return self._begin(int(self.rng.integers(SEEDS)))

    def _begin(self, seed: int) -> list[TimeStep]:
        raise NotImplementedError

    def _by_agent(self, action: Any) -> dict[str, Action]:
        actions = action if isinstance(action, list) else [action]  # of a single agent
        return dict(zip(self.spaces, actions, strict=True))

    def _timesteps(
        self,
        observations: Mapping[str, Any],
        rewards: Mapping[str, float],
        infos: Mapping[str, Any],
        terminations: Mapping[str, bool],
        truncations: Mapping[str, bool],
        deciding: Collection[str],
    ) -> list[TimeStep]:
        """Return a timestep per possible agent; `deciding` are those that act next if they have not ended."""
        self.seen.update((agent, self.spaces[agent].observe(seen)) for agent, seen in observations.items())
        ended = {agent for ends in (terminations, truncations) for agent, end in ends.items() if end}
        self.terminated |= {agent: bool(terminations.get(agent)) for agent in ended}
        over = ended.issuperset(self.env.agents)
        timesteps = []
        for agent, spaces in self.spaces.items():
            seen, paid = self.seen[agent], {"reward": float(rewards.get(agent, 0.0))}
            if over:
                timesteps.append((termination if self.terminated.get(agent, True) else truncation)(seen, paid))
            elif agent in deciding and agent not in ended:
                if agent not in observations:
                    raise ValueError(
                        f"the environment returned no observation of {agent}, which is among its agents; it returned "
                        f"those of {', '.join(map(str, observations)) or 'nobody'}"
                    )
                timesteps.append(transition(seen, paid, spaces.masks(observations[agent], infos.get(agent, {}))))
            else:
                timesteps.append(waiting(seen, paid))
        return timesteps


class ParallelGame(PettingZooGame):
    """An environment in which all agents act at once."""

    def _begin(self, seed: int) -> list[TimeStep]:
        observations, infos = self.env.reset(seed=seed)
        return self._timesteps(observations, {}, infos, {}, {}, self.env.agents)

    def step(self, action: Any) -> list[TimeStep]:
        """Advance the environment by the actions of the agents that are there."""
        actions = self._by_agent(action)
        with self.display.own():
            chosen = {agent: self.spaces[agent].act(actions[agent]) for agent in self.env.agents}
            observations, rewards, terminations, truncations, infos = self.env.step(chosen)
            return self._timesteps(observations, rewards, infos, terminations, truncations, self.env.agents)


class TurnsGame(PettingZooGame):
    """An environment in which one agent acts after the other (AEC)."""

    def _begin(self, seed: int) -> list[TimeStep]:
        self.env.reset(seed=seed)
        return self._look({})

    def step(self, action: Any) -> list[TimeStep]:
        """Advance the environment by the action of the agent whose turn it is."""
        with self.display.own():
            agent = self.env.agent_selection
            self.env.step(self.spaces[agent].act(self._by_agent(action)[agent]))
            return self._look(self.env.rewards)

    def _look(self, rewards: Mapping[str, float]) -> list[TimeStep]:
        """Return what all agents see, then remove those that have ended, as PettingZoo wants, until one can act."""
        env = self.env
        terminations, truncations, rewards = dict(env.terminations), dict(env.truncations), dict(rewards)
        observations = {agent: env.observe(agent) for agent in env.agents}
        while env.agents and (terminations[env.agent_selection] or truncations[env.agent_selection]):
            env.step(None)
            if env.agents:
                observations[env.agent_selection] = env.observe(env.agent_selection)
        return self._timesteps(observations, rewards, env.infos, terminations, truncations, [env.agent_selection])
