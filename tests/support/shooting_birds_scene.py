"""One arena of Shooting Birds in which a test puts what it wants."""

from collections.abc import Iterable
from typing import Any

import numpy as np

from joybridge.contract.tensors import Array
from joybridge.games.shooting_birds import rules as r
from joybridge.games.shooting_birds.game import CHANNELS
from joybridge.games.shooting_birds.levels import FLIGHTS, Obstacles
from joybridge.games.shooting_birds.sensing import cast_rays, front
from joybridge.simulator.randomness import open_streams, reserve

LARGE, MEDIUM, SMALL = range(3)
AWAY = 1000.0  # the height at which a bird meets nothing
NEAR = 1e-12

Point = tuple[float, float]


def obstacles(boxes: Iterable[tuple[float, ...]] = (), discs: Iterable[tuple[float, ...]] = ()) -> Obstacles:
    """Return a single level of boxes (left, bottom, right, top) and discs (x, y, radius) at depth 0."""
    box_rows, disc_rows = [(*box, 0.0) for box in boxes], [(*disc, 0.0) for disc in discs]
    return Obstacles(
        np.array(disc_rows, float).reshape(1, -1, 4),
        np.array([len(disc_rows)]),
        np.array(box_rows, float).reshape(1, -1, 5),
        np.array([len(box_rows)]),
    )


class Scene:
    """One arena, its birds far away and at rest but for those that a test puts somewhere, and its ticks."""

    def __init__(
        self,
        rules: r.Rules = r.ORIGINAL,
        place: Point = (0.0, 0.0),
        level: int = 0,
        ammo: int = 8,
        things: Obstacles | None = None,
    ) -> None:
        self.rules, self.streams = rules, open_streams(1, 0, 1)
        self.things = obstacles() if things is None else things
        self.world = r.World(rules, self.things, FLIGHTS, 0, -1, 0)
        self.arenas = np.zeros(1, r.ARENA).view(np.recarray)
        self.arena: Any = self.arenas[0]
        self.birds: Any = self.arenas.birds[0]
        self.birds.y = AWAY
        self.arena.x, self.arena.y = place
        self.arena.level, self.arena.ammo, self.arena.bird_speed = level, ammo, 1.0

    @property
    def place(self) -> Point:
        return float(self.arena.x), float(self.arena.y)

    @property
    def velocity(self) -> Point:
        return float(self.arena.vx), float(self.arena.vy)

    def put(self, bird: int = 0, kind: int = LARGE, at: Point | None = None, z: float | None = None) -> None:
        """Put a bird somewhere: at the crosshair, at the usual depth of its kind, if nothing else is said."""
        self.birds[bird].x, self.birds[bird].y = self.place if at is None else at
        self.birds[bird].kind = kind
        self.birds[bird].z = kind - 0.15 if z is None else z

    def tick(self, velocity: Point = (0.0, 0.0), shoot: int = 0, reload: int = 0, count: int = 1) -> Array:
        """Advance by some ticks and return the sum of their rewards per channel."""
        rewards = np.zeros((1, len(CHANNELS)))
        for _ in range(count):
            reserve(self.streams, r.MAX_DRAWS)
            action = np.array([velocity], float), np.array([shoot], np.int32), np.array([reload], np.int32)
            r.tick(self.arenas, self.streams, self.world, *action, rewards)
        return rewards[0]

    def coming(self, count: int) -> Array:
        """Return the random numbers, in [0, 1), that the next tick will draw first."""
        reserve(self.streams, r.MAX_DRAWS)
        begin = self.streams.cursor[0]
        return self.streams.values[0, begin : begin + count].copy()

    def front(self) -> int:
        return front(self.arena, self.things)

    def rays(self) -> Array:
        """Return bird distance, size code and obstacle distance of the twelve rays; distances in units, -1 for none."""
        rays = np.full((12, 3), np.nan, np.float32)
        cast_rays(self.arena, self.things, rays)
        return np.stack([np.where(rays[:, k] < 0, -1, rays[:, k] * (1 if k == 1 else 14)) for k in range(3)], axis=1)


PLACES = {"barn": (5.0, 0.0), "trunk": (-10.27, -5.0), "crown": (-13.5, 4.0), "open": (-2.0, 9.0)}  # of level 0
