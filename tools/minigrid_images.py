"""MiniGrid for `joybridge serve --gym tools.minigrid_images:MiniGridImages-v0`: a module that registers an environment.

MiniGrid's observations have a text, the mission, which `--gym` refuses. A wrapper of MiniGrid leaves the image alone.
"""

from typing import Any

import gymnasium
from minigrid.wrappers import ImgObsWrapper


def make(**settings: Any) -> gymnasium.Env[Any, Any]:
    """Return an empty room of MiniGrid whose observation is what the agent sees, uint8 [7, 7, 3]."""
    return ImgObsWrapper(gymnasium.make("MiniGrid-Empty-5x5-v0", **settings))


gymnasium.register("MiniGridImages-v0", make)
