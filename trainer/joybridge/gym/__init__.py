"""The games of any joybridge.v1 server as Gymnasium and PettingZoo environments.

    envs = BridgeVectorEnv("shooting_birds", arenas=15)                 many arenas, one call for all of them
    env = BridgeEnv("shooting_birds", layout="hybrid")                  one arena
    env = BridgeParallelEnv("shooting_birds", layout="multiagent")      PettingZoo: one arena, an agent per policy

Importing this module registers the built-in games, for `gymnasium.make("joybridge/ShootingBirds-v0")` and
`gymnasium.make_vec`; "joybridge.gym:joybridge/ShootingBirds-v0" names one without an import. It needs no torch.

An observation is the sensors in the spec's order, flattened side by side, float32, and the last `frame_stack` of
those frames, oldest first, zeros before an episode's first. A reward is the weighted sum of the channels. The
action space is what the layout (trainer/actions.py) gives a policy: MultiDiscrete, or a Box of -1..1 whose ends
are the layout's clipping, or for both a Dict of the Box as "continuous" and the MultiDiscrete as "discrete".

An info names "action_mask" where the game forbids choices in this step and "deciding" where some lane waits; the
actions of lanes that wait are ignored. Where an episode has ended, its info is its metrics by name.

Without the address of a simulator an environment runs its own, and ends it when it is closed or collected. gRPC
does not survive a fork: a process that has had an environment starts others by spawning, as AsyncVectorEnv does with
context="spawn". BridgeVectorEnv needs none.
"""

from typing import Any

import gymnasium

from joybridge.gym.environments import BridgeEnv, BridgeParallelEnv, BridgeVectorEnv

__all__ = ["REGISTERED", "BridgeEnv", "BridgeParallelEnv", "BridgeVectorEnv", "make_vector"]

REGISTERED = {"ShootingBirds": "shooting_birds", "BeastlyRivals": "beastly_rivals"}  # joybridge/NAME-v0 -> game


def make_vector(num_envs: int, **settings: Any) -> BridgeVectorEnv:
    """Return BridgeVectorEnv(arenas=num_envs, **settings): what `gymnasium.make_vec` calls."""
    return BridgeVectorEnv(arenas=num_envs, **settings)


def _register() -> None:
    for name, game in REGISTERED.items():
        gymnasium.register(
            f"joybridge/{name}-v0", f"{__name__}:BridgeEnv", vector_entry_point=f"{__name__}:make_vector",
            kwargs={"game": game},
        )  # fmt: skip


_register()
