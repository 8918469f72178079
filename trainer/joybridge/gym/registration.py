"""The built-in games under the names of Gymnasium: joybridge/ShootingBirds-v0 and so on."""

from typing import Any

import gymnasium

from joybridge.gym.vector_env import BridgeVectorEnv

# A list of its own: this package does not import the simulator.
GAMES = (
    "archer", "beastly_rivals", "beastly_rivals_full", "catch_point", "ferry", "goal", "hard_goal", "hard_move",
    "marble", "moving", "noughts", "orchard", "platform", "recall", "shooting_birds", "sliding",
)  # fmt: skip


def environment_id(game: str) -> str:
    """Return the name of a game's environment: joybridge/ShootingBirds-v0 for shooting_birds."""
    return f"joybridge/{game.title().replace('_', '')}-v0"


def make_vector(num_envs: int, **settings: Any) -> BridgeVectorEnv:
    """Return a BridgeVectorEnv with `num_envs` arenas; `gymnasium.make_vec` calls this."""
    return BridgeVectorEnv(arenas=num_envs, **settings)


def register_games() -> None:
    """Register every built-in game. Those with several agents say at `make` that they need BridgeParallelEnv."""
    for game in GAMES:
        gymnasium.register(
            environment_id(game),
            entry_point="joybridge.gym:BridgeEnv",
            vector_entry_point=f"{__name__}:make_vector",
            kwargs={"game": game},
        )
