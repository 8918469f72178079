"""One arena of a game with all its agents as an environment of PettingZoo."""

from collections.abc import Mapping, Sequence
from typing import Any

from gymnasium.spaces import Box, Dict
from pettingzoo import ParallelEnv

from joybridge.client.own_games import Game, Games
from joybridge.config.game_settings import Value
from joybridge.contract.tensors import Array
from joybridge.gym.bridge import Bridge, batch_of_one
from joybridge.gym.player import ActionError
from joybridge.gym.settings import EnvSettings
from joybridge.gym.spaces import ActionSpaces


class BridgeParallelEnv(ParallelEnv):  # type: ignore[misc]
    """One arena of any game, with one PettingZoo agent for each policy of each agent of the game.

    The name of an agent is that of its policy: the behavior's, or "axes" and "buttons" for the two policies of the
    layout `multiagent`, which act together (with the behavior's name in front if there are several behaviors). If a
    behavior has several agents, "_0", "_1" and so on follow.
    """

    metadata: dict[str, Any] = {"name": "joybridge", "render_modes": ["rgb_array"], "is_parallelizable": True}  # noqa: RUF012

    def __init__(
        self,
        game: Game,
        *,
        layout: str = "hybrid",
        frame_stack: int = 3,
        flatten: bool = True,
        seed: int = 0,
        options: Mapping[str, str] | None = None,
        parameters: Mapping[str, Value] | None = None,
        sensors: Mapping[str, Sequence[str]] | None = None,
        reward_weights: Mapping[str, Mapping[str, float]] | None = None,
        forbidden: str = "error",
        others: Sequence[str] = (),
        games: Games = (),
        simulator: str | None = None,
        render_mode: str | None = None,
    ) -> None:
        """Open a session with a simulator; arguments and errors are those of BridgeVectorEnv.

        sensors and reward_weights are by agent: {agent: [sensor, ...]} and {agent: {channel: weight}}.
        """
        settings = EnvSettings(
            game=game,
            arenas=1,
            layout=layout,
            frame_stack=frame_stack,
            flatten=flatten,
            seed=seed,
            options=options,
            parameters=parameters,
            sensors=sensors,
            reward_weights=reward_weights,
            forbidden=forbidden,
            games=games,
            simulator=simulator,
            render_mode=render_mode,
            others=others,
        )
        self._bridge = Bridge(settings, single=False, split=True)
        self.game_spec = self._bridge.spec
        self.metadata = self._bridge.metadata(self.metadata)
        self.render_mode = render_mode
        self.possible_agents = list(self._bridge.players)
        self.agents: list[str] = []

    def observation_space(self, agent: str) -> Box | Dict:
        """Return the space of an agent's observations."""
        return self._bridge.players[agent].observation_space

    def action_space(self, agent: str) -> ActionSpaces:
        """Return the space of an agent's actions."""
        return self._bridge.players[agent].action_space

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, dict[str, Any]]]:
        """Begin an episode; return observations and infos by agent.

        Arguments and errors are those of BridgeVectorEnv.reset, but unknown options are ignored, as PettingZoo's tests
        require.
        """
        self._bridge.reset(seed, (options or {}).get("parameters", {}))
        self.agents = list(self.possible_agents)
        firsts = [player.first() for player in self._bridge.players.values()]
        observations, infos = (dict(zip(self.agents, column, strict=True)) for column in zip(*firsts, strict=True))
        return observations, infos

    def step(
        self, actions: Mapping[str, Any]
    ) -> tuple[dict[str, Any], dict[str, float], dict[str, bool], dict[str, bool], dict[str, dict[str, Any]]]:
        """Play one decision; return observations, rewards, terminations, truncations and infos by agent.

        Agents that wait need no action. Raises ActionError for an action that is missing, does not fit the space of its
        agent or is forbidden.
        """
        players = self._bridge.players
        for agent in self.agents:
            if agent not in actions and players[agent].decides():
                raise ActionError(f"actions has none of agent {agent!r}, expected one each of {', '.join(self.agents)}")
        self._bridge.play([(players[a], batch_of_one(actions[a])) for a in self.agents if a in actions])
        outcomes = {agent: players[agent].outcome() for agent in self.agents}
        self.agents = [agent for agent, outcome in outcomes.items() if not (outcome[2] or outcome[3])]
        self._bridge.playing = bool(self.agents)
        columns: Any = zip(*outcomes.values(), strict=True)
        observations, rewards, terminated, truncated, infos = (dict(zip(outcomes, c, strict=True)) for c in columns)
        return observations, rewards, terminated, truncated, infos

    def render(self) -> Array | None:
        """Return the picture after the last step, as BridgeEnv.render does."""
        pictures = self._bridge.render()
        return pictures[0] if pictures else None

    def close(self) -> None:
        """End the session, and the simulator if this environment has started it."""
        self._bridge.close()
