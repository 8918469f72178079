"""Environments are made without a render mode where their pictures are the same without one."""

import gymnasium
import numpy as np
import pytest
from gymnasium import spaces

from joybridge.adapters.rendering import choose_rendering, draw


class Sparks(gymnasium.Env):  # type: ignore[misc]
    """An environment that does more in each step if it has a render mode; `needs`: its picture differs without one."""

    metadata = {"render_modes": ["rgb_array"]}  # noqa: RUF012
    observation_space = action_space = spaces.Discrete(2)

    def __init__(self, render_mode=None, needs=False):
        self.render_mode, self.shade = render_mode, 50 if needs and render_mode else 0

    def reset(self, *, seed=None, options=None):
        return 0, {}

    def render(self):
        assert self.render_mode == "rgb_array"
        return np.full((4, 6, 3), self.shade, np.uint8)


@pytest.mark.parametrize("needs", [False, True])
def test_a_mode_is_given_only_where_the_picture_needs_it(needs):
    arguments, size = choose_rendering(Sparks, {"needs": needs})
    assert size == (6, 4)
    assert arguments.get("render_mode") == ("rgb_array" if needs else None)
    env = Sparks(**arguments)
    assert draw(env).max() == (50 if needs else 0)
    assert env.render_mode == arguments.get("render_mode")
