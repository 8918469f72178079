"""The environments: many arenas, one arena with one agent, one arena with all its agents."""

from collections.abc import Mapping
from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box, Dict, MultiDiscrete
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from pettingzoo import ParallelEnv

from joybridge.contract.tensors import Array
from joybridge.gym.bridge import Bridge
from joybridge.gym.lanes import Outcome


class BridgeVectorEnv(VectorEnv):  # type: ignore[misc]
    """Arenas of a game with one behavior; its lanes, arenas × agents, are the `num_envs`.

    An episode that ends is followed by the next one in the same step: observations already belong to that, and
    infos hold the last of the old one, "final_obs", and its metrics, "final_info". "action_mask" is bool
    [num_envs, choices of all branches side by side]. Rewards are float64. A broken connection or a refusal of the
    simulator raises SimulatorError and is the end of the environment.
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "autoreset_mode": AutoresetMode.SAME_STEP}  # noqa: RUF012

    def __init__(
        self,
        game: str,
        arenas: int = 15,
        layout: str = "bucket-11",
        frame_stack: int = 3,
        seed: int = 0,
        options: Mapping[str, str] | None = None,
        parameters: Mapping[str, float] | None = None,
        simulator: str | None = None,
        reward_weights: Mapping[str, float] | None = None,
        render_mode: str | None = None,
    ) -> None:
        """Open a session at `simulator` (HOST:PORT or unix:PATH), or at one of one's own.

        seed: of what is played until a reset gives another one. options and parameters: the game's, by name.
        reward_weights: weights of reward channels, where they differ from the game's defaults.

        Raises ValueError for arguments that fit no game or not this one, SimulatorError where the simulator
        refuses, SimulatorLost where it cannot be reached.
        """
        self._bridge = Bridge(
            game, arenas=arenas, layout=layout, frame_stack=frame_stack, seed=seed, options=options,
            parameters=parameters, simulator=simulator, reward_weights=reward_weights, render_mode=render_mode,
            single=True, split=False,
        )  # fmt: skip
        self.game_spec = self._bridge.spec
        self.metadata = self._bridge.metadata(self.metadata)
        self.render_mode = render_mode
        (self._player,) = self._bridge.players.values()
        self.num_envs = arenas * self._player.behavior.agents_per_arena
        self.single_observation_space = self._player.lanes.space
        self.single_action_space = self._player.space
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Array, dict[str, Any]]:
        """Begin new episodes everywhere; return observations and infos.

        With a seed, what follows is what a new environment with it would play. Without, the arenas' random streams
        go on; where all episodes have only just begun, at the start or as all ended in the last step, those are taken.
        options: {"parameters": {name: value}} changes parameters of the game. Raises ValueError.
        """
        seed = self._bridge.reset(seed, _parameters(options))
        super().reset(seed=seed)
        return self._player.lanes.now.copy(), self._infos()

    def step(self, actions: Any) -> tuple[Array, Array, Array, Array, dict[str, Any]]:
        """Advance every arena by one decision. Raises ValueError for actions outside the action space's shape.

        Continuous actions outside -1..1 act like the nearest end.
        """
        self._bridge.play([(self._player, actions)])
        lanes, step = self._player.lanes, self._player.lanes.step
        infos = self._infos()
        if len(step.ended):
            infos |= self._final_infos()
        return lanes.now.copy(), self._player.rewards(), step.terminated.copy(), step.truncated.copy(), infos

    def render(self) -> tuple[Array, ...] | None:
        """Return the arenas' pictures after the last step, uint8 [height, width, 3] each.

        None before the first step after a reset, and without `render_mode`: the simulator draws with a step.
        """
        return tuple(picture.copy() for picture in self._bridge.pictures) or None

    def close_extras(self, **kwargs: Any) -> None:
        """End the session, and the simulator if it is one's own."""
        self._bridge.close()

    def _infos(self) -> dict[str, Any]:
        infos = self._player.infos()
        return infos | {f"_{name}": np.ones(self.num_envs, bool) for name in infos}

    def _final_infos(self) -> dict[str, Any]:
        lanes, ended = self._player.lanes, self._player.lanes.step.ended
        present = np.zeros(self.num_envs, bool)
        present[ended] = True
        observations = np.full(self.num_envs, None, object)
        for lane in ended:
            observations[lane] = lanes.last[lane].copy()
        info: dict[str, Array] = {}
        for name, column in lanes.metrics().items():
            values = np.zeros(self.num_envs, np.float32)
            values[ended] = column
            info |= {name: values, f"_{name}": present.copy()}
        return {
            "final_obs": observations, "_final_obs": present.copy(),
            "final_info": info, "_final_info": present.copy(),
        }  # fmt: skip


class BridgeEnv(gymnasium.Env):  # type: ignore[misc]
    """One arena of a game with one agent. An info's "action_mask" is what `action_space.sample` takes as mask."""

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"]}  # noqa: RUF012

    def __init__(self, game: str, **settings: Any) -> None:
        """Open a session; settings are the arguments of BridgeVectorEnv but `arenas`, and the errors are its."""
        self._bridge = Bridge(game, **settings, single=True, split=True)
        self.game_spec = self._bridge.spec
        self.metadata = self._bridge.metadata(self.metadata)
        self.render_mode = settings.get("render_mode")
        (self._player,) = self._bridge.players.values()
        self.observation_space = self._player.lanes.space
        self.action_space = self._player.space

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Array, dict[str, Any]]:
        """Begin an episode, as BridgeVectorEnv does; return observation and info. Raises ValueError."""
        seed = self._bridge.reset(seed, _parameters(options))
        super().reset(seed=seed)
        return self._player.first()

    def step(self, action: Any) -> Outcome:
        """Play one decision. Raises ValueError for an action outside the action space's shape."""
        self._bridge.play([(self._player, _one_row(action))])
        outcome = self._player.outcome()
        self._bridge.playing = not (outcome[2] or outcome[3])
        return outcome

    def render(self) -> Array | None:
        """Return the picture after the last step, uint8 [height, width, 3]; None without `render_mode`.

        The simulator draws with a step: where an episode ended in it, the picture is of the next one's beginning,
        and before the first step it is black.
        """
        return self._bridge.picture()

    def close(self) -> None:
        """End the session, and the simulator if it is one's own."""
        self._bridge.close()


class BridgeParallelEnv(ParallelEnv):  # type: ignore[misc]
    """One arena of any game as a PettingZoo environment, with an agent for each policy of each agent of the game.

    A policy that holds a whole device is named after its behavior, one that holds a part after the part ("axes" and
    "buttons" of the layout `multiagent`, which act together), with the behavior's name in front where there are
    several; "_0", "_1" … follow where a behavior has several agents. Each observes all sensors of its behavior.
    """

    metadata: dict[str, Any] = {"name": "joybridge", "render_modes": ["rgb_array"], "is_parallelizable": True}  # noqa: RUF012

    def __init__(self, game: str, **settings: Any) -> None:
        """Open a session; settings are the arguments of BridgeVectorEnv but `arenas`, and the errors are its.

        reward_weights: per agent, {agent: {channel: weight}}.
        """
        self._bridge = Bridge(game, **settings, single=False, split=True)
        self.game_spec = self._bridge.spec
        self.metadata = self._bridge.metadata(self.metadata)
        self.render_mode = settings.get("render_mode")
        self.possible_agents = list(self._bridge.players)
        self.agents: list[str] = []

    def observation_space(self, agent: str) -> Box:
        """Return the space of an agent's observations."""
        return self._bridge.players[agent].lanes.space

    def action_space(self, agent: str) -> Box | MultiDiscrete | Dict:
        """Return the space of an agent's actions."""
        return self._bridge.players[agent].space

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Array], dict[str, dict[str, Any]]]:
        """Begin an episode, as BridgeVectorEnv does; return observations and infos by agent.

        What options hold besides "parameters" is ignored, as PettingZoo's tests demand. Raises ValueError.
        """
        self._bridge.reset(seed, (options or {}).get("parameters", {}))
        self.agents = list(self.possible_agents)
        firsts = [player.first() for player in self._bridge.players.values()]
        observations, infos = (dict(zip(self.agents, column, strict=True)) for column in zip(*firsts, strict=True))
        return observations, infos

    def step(
        self, actions: Mapping[str, Any]
    ) -> tuple[dict[str, Array], dict[str, float], dict[str, bool], dict[str, bool], dict[str, dict[str, Any]]]:
        """Play one decision; return observations, rewards, terminations, truncations and infos by agent.

        Raises ValueError for an action that is missing, unless its agent waits, or outside its space's shape.
        """
        players = self._bridge.players
        for agent in self.agents:
            if agent not in actions and players[agent].decides():
                raise ValueError(f"actions has none of agent {agent!r}, expected one each of {', '.join(self.agents)}")
        self._bridge.play([(players[a], _one_row(actions[a])) for a in self.agents if a in actions])
        outcomes = {agent: players[agent].outcome() for agent in self.agents}
        self.agents = [agent for agent, outcome in outcomes.items() if not (outcome[2] or outcome[3])]
        self._bridge.playing = bool(self.agents)
        columns: Any = zip(*outcomes.values(), strict=True)
        observations, rewards, terminated, truncated, infos = (dict(zip(outcomes, c, strict=True)) for c in columns)
        return observations, rewards, terminated, truncated, infos

    def render(self) -> Array | None:
        """Return the picture after the last step, uint8 [height, width, 3]; None without `render_mode`.

        The simulator draws with a step: where an episode ended in it, the picture is of the next one's beginning,
        and before the first step it is black.
        """
        return self._bridge.picture()

    def close(self) -> None:
        """End the session, and the simulator if it is one's own."""
        self._bridge.close()


def _one_row(action: Any) -> Any:
    """Return one lane's action as a batch of one."""
    if isinstance(action, Mapping):
        return {kind: np.asarray(part)[None] for kind, part in action.items()}
    return np.asarray(action)[None]


def _parameters(options: Mapping[str, Any] | None) -> Mapping[str, float]:
    """Return what the options of a reset say about parameters. Raises ValueError for other options."""
    for name in options or {}:
        if name != "parameters":
            raise ValueError(f"reset: unknown option {name!r}, expected parameters")
    parameters: Mapping[str, float] = (options or {}).get("parameters", {})
    return parameters
