"""Many arenas of a game as one vector environment of Gymnasium."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from joybridge.client.own_games import Game, Games
from joybridge.config.game_settings import Value
from joybridge.contract.tensors import Array
from joybridge.gym.bridge import Bridge, only_parameters
from joybridge.gym.observer import one_row
from joybridge.gym.settings import EnvSettings


class BridgeVectorEnv(VectorEnv):  # type: ignore[misc]
    """Many arenas of a game with one behavior. `num_envs` is the number of lanes: arenas x agents per arena.

    Autoreset is SAME_STEP: when an episode ends, the next one begins in the same step. The observations are then those
    of the next episode; infos hold the last observation, "final_obs", and the metrics, "final_info". Rewards are
    float64 [num_envs].
    """

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"], "autoreset_mode": AutoresetMode.SAME_STEP}  # noqa: RUF012

    def __init__(
        self,
        game: Game,
        arenas: int = 75,
        *,
        layout: str = "hybrid",
        frame_stack: int = 3,
        flatten: bool = True,
        seed: int = 0,
        options: Mapping[str, str] | None = None,
        parameters: Mapping[str, Value] | None = None,
        sensors: Sequence[str] | None = None,
        reward_weights: Mapping[str, float] | None = None,
        forbidden: str = "error",
        others: Sequence[str] = (),
        games: Games = (),
        simulator: str | None = None,
        render_mode: str | None = None,
    ) -> None:
        """Open a session with a simulator.

        game: the name of a game, or a game of your own: its class or "MODULE:CLASS". layout: how the action space maps
        to the axes and buttons of the game: "hybrid", "bucket-N", "threshold-T" or "multiagent". frame_stack: frames
        per observation. flatten: whether an observation is one array, or a dict with an array for each sensor. seed: of
        all episodes until a reset with another seed. options and parameters: of the game, by name; a parameter
        is a number, or drawn at each episode, as in {"uniform": [0.5, 1.0]}. sensors: names of those to observe; None:
        all. reward_weights: weights of reward channels that differ from the defaults of the
        game. forbidden: what a choice that its mask forbids does: "error" raises ActionError, "first_allowed" plays the
        first choice of its branch that is allowed. others: who hold all seats but the first of each arena, in a game of
        several agents, in turn: folders of runs, exported policies or script:NAME, as in `joybridge evaluate --others`;
        this needs joybridge[train]. games: further games of your own to offer. simulator: HOST:PORT or
        unix:PATH of one that is running; None: start one. render_mode: None or "rgb_array".

        Raises ConfigError, which is a ValueError, for an argument that cannot be used; SimulatorError if the simulator
        rejects an option or parameter; SimulatorLost if it cannot be started or reached.
        """
        settings = EnvSettings(
            game=game,
            arenas=arenas,
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
        self._bridge = Bridge(settings, single=True, split=False)
        self.game_spec = self._bridge.spec
        self.metadata = self._bridge.metadata(self.metadata)
        self.render_mode = render_mode
        (self._player,) = self._bridge.players.values()
        self.num_envs = self._player.lanes
        self.single_observation_space = self._player.observation_space
        self.single_action_space = self._player.action_space
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Begin new episodes in all arenas; return observations and infos.

        With a seed, the episodes are those of a new environment with this seed. Without, the random streams of the
        arenas continue; episodes that have just begun, at the start or because all ended in the last step, are kept.
        options: {"parameters": {name: value}} changes parameters of the game. Raises ConfigError or SpecError.
        """
        seed = self._bridge.reset(seed, only_parameters(options))
        super().reset(seed=seed)
        return self._player.observations(), self._infos()

    def step(self, actions: Any) -> tuple[Any, Array, Array, Array, dict[str, Any]]:
        """Play one decision in every arena. Raises ActionError for actions that do not fit or are forbidden."""
        self._bridge.play([(self._player, actions)])
        step, infos = self._player.step, self._infos()
        if len(step.ended):
            infos |= self._final_infos()
        observations, rewards = self._player.observations(), self._player.rewards()
        return observations, rewards, step.terminated.copy(), step.truncated.copy(), infos

    def render(self) -> tuple[Array, ...] | None:
        """Return the arenas' pictures after the last step, uint8 [height, width, 3] each; None without `render_mode`.

        Drawing is slow, and the simulator draws in a step. So steps are drawn from the first call of `render` until the
        next reset; the pictures of the first call are black.
        """
        pictures = self._bridge.render()
        return None if pictures is None else tuple(pictures)

    def close_extras(self, **kwargs: Any) -> None:
        """End the session, and the simulator if this environment has started it."""
        self._bridge.close()

    def _infos(self) -> dict[str, Any]:
        infos = self._player.infos()
        return infos | {f"_{name}": np.ones(self.num_envs, bool) for name in infos}

    def _final_infos(self) -> dict[str, Any]:
        ended = self._player.step.ended
        present = np.zeros(self.num_envs, bool)
        present[ended] = True
        observations = np.full(self.num_envs, None, object)
        for row, lane in enumerate(ended):
            observations[lane] = one_row(self._player.final, row)
        info: dict[str, Array] = {}
        for name, column in self._player.metrics().items():
            values = np.zeros(self.num_envs, np.float32)
            values[ended] = column
            info |= {name: values, f"_{name}": present.copy()}
        return {
            "final_obs": observations,
            "_final_obs": present.copy(),
            "final_info": info,
            "_final_info": present.copy(),
        }
