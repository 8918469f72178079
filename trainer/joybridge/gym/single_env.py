"""One arena of a game with one agent as an environment of Gymnasium."""

from collections.abc import Mapping, Sequence
from typing import Any

import gymnasium

from joybridge.client.own_games import Game, Games
from joybridge.config.game_settings import Value
from joybridge.contract.tensors import Array
from joybridge.gym.bridge import Bridge, batch_of_one, only_parameters
from joybridge.gym.player import Outcome
from joybridge.gym.settings import EnvSettings


class BridgeEnv(gymnasium.Env):  # type: ignore[misc]
    """One arena of a game with one agent."""

    metadata: dict[str, Any] = {"render_modes": ["rgb_array"]}  # noqa: RUF012

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
        sensors: Sequence[str] | None = None,
        reward_weights: Mapping[str, float] | None = None,
        forbidden: str = "error",
        others: Sequence[str] = (),
        games: Games = (),
        simulator: str | None = None,
        render_mode: str | None = None,
    ) -> None:
        """Open a session with a simulator; arguments and errors are those of BridgeVectorEnv."""
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
        self._bridge = Bridge(settings, single=True, split=True)
        self.game_spec = self._bridge.spec
        self.metadata = self._bridge.metadata(self.metadata)
        self.render_mode = render_mode
        (self._player,) = self._bridge.players.values()
        self.observation_space = self._player.observation_space
        self.action_space = self._player.action_space

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Any, dict[str, Any]]:
        """Begin an episode; return observation and info. Arguments and errors are those of BridgeVectorEnv.reset."""
        seed = self._bridge.reset(seed, only_parameters(options))
        super().reset(seed=seed)
        return self._player.first()

    def step(self, action: Any) -> Outcome:
        """Play one decision. Raises ActionError for an action that does not fit the action space or is forbidden."""
        self._bridge.play([(self._player, batch_of_one(action))])
        outcome = self._player.outcome()
        self._bridge.playing = not (outcome[2] or outcome[3])
        return outcome

    def render(self) -> Array | None:
        """Return the picture after the last step, uint8 [height, width, 3]; None without `render_mode`.

        Drawing is slow, and the simulator draws in a step. So steps are drawn from the first call of `render` until the
        next reset: an episode that is not rendered costs nothing, and the picture of the first call is black. After the
        last step of an episode the picture shows the beginning of the next one.
        """
        pictures = self._bridge.render()
        return pictures[0] if pictures else None

    def close(self) -> None:
        """End the session, and the simulator if this environment has started it."""
        self._bridge.close()
