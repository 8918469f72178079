"""A scripted player of Shooting Birds that knows the whole state: what a level or a kind of bird is worth at least.

It goes to the nearest bird in view, where that will be after the next tick, shoots whatever is in front, and reloads
when the gun is empty. It moves the crosshair by the locomotion `axes`.
"""

import numpy as np

from joybridge.contract.codec import ActArrays
from joybridge.contract.tensors import Array
from joybridge.games.shooting_birds import camera
from joybridge.games.shooting_birds.rules import EPISODE_TICKS, TICK, TOP_SPEED, World
from joybridge.games.shooting_birds.sensing import covered, front
from joybridge.simulator.compiled import compiled

REACH_X, REACH_Y = 17.7, 10.2  # units from the middle: how far the crosshair gets


def act(arenas: Array, world: World) -> ActArrays:
    """Return the player's action for every arena, records of dtype ARENA, for the locomotion `axes`."""
    axes = np.zeros((len(arenas), 2 + (world.camera == camera.AXIS)), np.float32)
    choices = np.zeros((len(arenas), 2 + (world.camera == camera.DRAG)), np.int32)
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
            if distance >= nearest or abs(x - arena.camera) > REACH_X or abs(y) > REACH_Y:
                continue
            if not covered(x, y, bird.z, arena.level, obstacles):
                nearest = distance
                axes[i, 0] = min(max(dx / step, -1.0), 1.0)
                axes[i, 1] = min(max(dy / step, -1.0), 1.0)
        if world.camera != camera.FIXED and nearest == np.inf:
            _travel(arena, world, axes[i], choices[i])
        choices[i, -2] = arena.ammo > 0 and front(arena, obstacles) >= 0
        choices[i, -1] = arena.ammo == 0


@compiled
def _travel(arena, world, axes, choices):
    """Move the camera towards the nearest bird that is not behind an obstacle."""
    nearest, side = np.inf, 1.0
    for bird in arena.birds:
        away = bird.x - arena.camera
        if bird.wait > 0 or abs(away) >= nearest or abs(bird.x) > camera.MAX_CAMERA_X + REACH_X:
            continue
        if not covered(bird.x, bird.y, bird.z, arena.level, world.obstacles):
            nearest, side = abs(away), 1.0 if away > 0.0 else -1.0
    if world.camera == camera.AXIS:
        axes[2] = side
    elif world.camera == camera.EDGE:
        axes[0] = side
    else:  # drag the field to the other side, then let go and come back
        place = (arena.x - arena.camera) * side
        drags = place > -16.0 and (arena.vx * side < 0.0 or place > 16.0)
        axes[0], choices[0] = (-side if drags else side), drags
