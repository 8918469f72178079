"""A scripted player of Shooting Birds that knows the whole state: what a level or a kind of bird is worth at least.

It goes to the nearest bird in view, where that will be after the next tick, shoots whatever is in front, and reloads
when the gun is empty. It moves the crosshair by the locomotion `axes`.
"""

import numpy as np

from joybridge.contract.codec import ActArrays
from joybridge.contract.tensors import Array
from joybridge.games.shooting_birds.rules import EPISODE_TICKS, TICK, TOP_SPEED, World
from joybridge.games.shooting_birds.sensing import covered, front
from joybridge.simulator.compiled import compiled

REACH_X, REACH_Y = 17.7, 10.2  # units from the middle: how far the crosshair gets


def act(arenas: Array, world: World) -> ActArrays:
    """Return the player's action for every arena, records of dtype ARENA: two axes, and the buttons shoot, reload."""
    axes, choices = np.zeros((len(arenas), 2), np.float32), np.zeros((len(arenas), 2), np.int32)
    _act(arenas, world, axes, choices)
    return ActArrays(axes, choices)


def play(game, ticks: int = EPISODE_TICKS) -> Array:
    """Play a game of any number of arenas; return the reward of each, float64 [arenas]."""
    weights = np.array([channel.default_weight for channel in game.channels])
    total = np.zeros(len(game.arenas))
    for _ in range(ticks):
        (step,) = game.step([act(game.arenas, game.world)])
        total += step.rewards @ weights
    return total


@compiled
def _act(arenas, world, axes, choices):
    """Write the axes [arenas, 2] and the choices [arenas, 2] of every arena."""
    obstacles, step = world.obstacles, TICK * TOP_SPEED
    for i in range(len(arenas)):
        arena = arenas[i]
        nearest = np.inf
        for bird in arena.birds:
            x, y = bird.x + bird.vx * TICK, bird.y + bird.vy * TICK
            dx, dy = x - arena.x, y - arena.y
            distance = max(abs(dx), abs(dy))
            if distance >= nearest or abs(x) > REACH_X or abs(y) > REACH_Y:
                continue
            if not covered(x, y, bird.z, arena.level, obstacles):
                nearest = distance
                axes[i, 0] = min(max(dx / step, -1.0), 1.0)
                axes[i, 1] = min(max(dy / step, -1.0), 1.0)
        choices[i, 0] = arena.ammo > 0 and front(arena, obstacles) >= 0
        choices[i, 1] = arena.ammo == 0
