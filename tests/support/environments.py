"""Tiny environments of Gymnasium whose numbers a test can predict; their IDs are registered on import."""

import subprocess
import time
from pathlib import Path

import gymnasium
import numpy as np
import pygame
from gymnasium import spaces


class Mixed(gymnasium.Env):  # type: ignore[misc]
    """Every kind of space at once; `last` is the last action. Terminated and truncated after three decisions."""

    metadata = {"render_modes": ["rgb_array"], "render_fps": 20}  # noqa: RUF012
    observation_space = spaces.Dict(
        {
            "arm": spaces.Dict({"speed": spaces.Box(-1.0, np.inf, (2,), np.float64)}),
            "image": spaces.Box(0, 255, (2, 3, 3), np.uint8),
            "lamps": spaces.MultiBinary(3),
            "pair": spaces.Tuple([spaces.Discrete(3, start=1), spaces.MultiDiscrete([2, 3])]),
        }
    )
    action_space = spaces.Dict(
        {
            "gear": spaces.Discrete(3, start=-1),
            "keys": spaces.MultiBinary(2),
            "levers": spaces.Box(np.array([-1.0, 0.1]), np.array([1.0, 0.8]), dtype=np.float64),
            "pair": spaces.Tuple([spaces.MultiDiscrete([2, 4]), spaces.Box(-5, 5, (), np.int32)]),
        }
    )

    def __init__(self, render_mode=None, fault=""):
        self.render_mode, self.fault = render_mode, fault
        self.clock, self.last = 0, None

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.clock = 0
        return self.observe(), {}

    def step(self, action):
        assert self.action_space.contains(action), action
        self.last = action
        self.clock += 1
        if self.clock == 2 and self.fault == "raises":
            raise RuntimeError("the arm is stuck")
        over = self.clock == 3
        reward = np.nan if self.clock == 2 and self.fault == "reward" else np.array([0.5])
        if self.clock == 2 and self.fault == "rewards":
            reward = np.array([0.5, 0.5])
        return self.observe(), reward, over, over, {"height": 10.0 * self.clock, "name": "text", 0: 1.0}

    def observe(self):
        speed = self.np_random.random(2)
        if self.clock == 2 and self.fault == "nan":
            speed[1] = np.nan
        return {
            "arm": {"speed": speed[:1] if self.clock == 2 and self.fault == "shape" else speed},
            "image": np.full((2, 3, 3), self.clock, np.uint8),
            "lamps": np.array([1, 0, 1], np.int8),
            "pair": (
                9 if self.clock == 2 and self.fault == "value" else 1 + self.clock % 3,
                np.array([1, self.clock % 3]),
            ),
        }

    def render(self):
        return np.full((4, 6, 3), 100 + self.clock, np.uint8)


class Masked(gymnasium.Env):  # type: ignore[misc]
    """The second choice of each branch is forbidden; how that is said depends on `where`."""

    def __init__(self, where="info"):
        self.where = where
        self.action_space = spaces.MultiDiscrete([2, 3])
        self.observation_space = spaces.Box(0, 1, (1,))
        if where == "observation":
            mask = spaces.Box(0, 1, (5,), np.int8)
            self.observation_space = spaces.Dict({"clock": self.observation_space, "action_mask": mask})
        if where == "method":
            self.action_masks = lambda: np.array([1, 0, 1, 0, 1], bool)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        return self.look()

    def step(self, action):
        return *(look := self.look())[:1], 0.0, False, False, look[1]

    def look(self):
        clock, flags = np.zeros(1, np.float32), np.array([1, 0, 1, 0, 1], np.int8)
        if self.where == "observation":
            return {"clock": clock, "action_mask": flags}, {}
        given = {"info": flags, "parts": (flags[:2], flags[2:]), "short": flags[:4]}
        return clock, {"action_mask": given[self.where]} if self.where in given else {}


class Spaces(gymnasium.Env):  # type: ignore[misc]
    """An environment with the given spaces that cannot be served."""

    def __init__(self, kind):
        box = spaces.Box(-1, 1, (1,))
        odd = {"text": spaces.Dict({"words": spaces.Text(5)}), "empty": spaces.Box(-1, 1, (2, 0))}
        self.observation_space = odd.get(kind, box)
        self.action_space = spaces.Box(-np.inf, 3.0, (2,)) if kind == "unbounded" else box


class Windy(gymnasium.Env):  # type: ignore[misc]
    """Shows the options of `reset`; `parameters` is what its metadata says of them."""

    observation_space = spaces.Box(-9, 9, (1,))
    action_space = spaces.Discrete(2)

    def __init__(self, parameters=None, wind=1):
        self.metadata = {"parameters": {"wind": (0, 2, 1)} if parameters is None else parameters}

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.wind = (options or {"wind": -1.0})["wind"]
        return np.array([self.wind], np.float32), {}

    def step(self, action):
        return np.array([self.wind], np.float32), self.wind, True, False, {}


class Painted(gymnasium.Env):  # type: ignore[misc]
    """Paints its clock on the display of pygame, of which the process has one, and sees what is on it.

    The clock begins at a multiple of 1000. `render` does not paint again.
    """

    metadata = {"render_modes": ["rgb_array"]}  # noqa: RUF012
    observation_space = spaces.Box(0.0, 1e6, (1,))
    action_space = spaces.Discrete(2)

    def __init__(self, render_mode=None, size=4):
        self.render_mode, self.size = render_mode, size
        self.display = pygame.display.set_mode((size, size))

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.clock = 1000 * int(self.np_random.integers(900))
        return self.paint(), {}

    def step(self, action):
        self.clock += 1
        return self.paint(), 0.0, False, False, {}

    def paint(self):
        assert self.display.get_size() == (self.size, self.size)
        self.display.fill(self.clock)
        time.sleep(1e-4)  # while another thread goes on
        return np.array([pygame.surfarray.array2d(self.display)[-1, -1]], np.float32)

    def render(self):
        return pygame.surfarray.array3d(pygame.display.get_surface())


class Holding(gymnasium.Env):  # type: ignore[misc]
    """An environment that holds a process, as those of game engines and emulators do, until it is closed.

    Each writes the process into `folder`. It fails to end it if `stubborn`.
    """

    observation_space = spaces.Box(0, 1, (1,))
    action_space = spaces.Discrete(2)

    def __init__(self, folder, stubborn=False):
        self.stubborn = stubborn
        self.process = subprocess.Popen(["sleep", "3600"], stdout=subprocess.DEVNULL)
        Path(folder, str(self.process.pid)).touch()

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        return np.zeros(1, np.float32), {}

    def step(self, action):
        return np.zeros(1, np.float32), 0.0, False, False, {}

    def close(self):
        if self.stubborn:
            raise RuntimeError("the process does not end")
        self.process.kill()
        self.process.wait()


for environment in (Mixed, Masked, Spaces, Windy, Painted, Holding):
    gymnasium.register(f"{environment.__name__}-v0", environment)
