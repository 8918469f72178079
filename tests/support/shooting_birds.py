"""Shooting Birds in tests: games, actions, and play that depends on what is observed alone."""

from typing import Any

import numpy as np

from joybridge.contract.codec import ActArrays
from joybridge.contract.tensors import Array
from joybridge.games.shooting_birds.game import ShootingBirds

HIT, MISS, DRY_SHOT, RELOAD, AIMED_HIT, AIMED_MISS = range(6)
DEFAULTS = {option.name: option.default_choice for option in ShootingBirds.options}
WEIGHTS = np.array([1, 1, 1, 1, 0, 0])
NEAR = 1e-6  # of float32
STILL = (0.0, 0.0)


def new_game(
    arenas: int = 1, first_arena: int = 0, seed: int = 5, parameters: dict[str, float] | None = None, **options: str
) -> ShootingBirds:
    return ShootingBirds({**DEFAULTS, **options}, parameters or {}, arenas, first_arena, seed)


def action(lanes: int, axes: tuple[float, ...] = STILL, choices: tuple[int, ...] = (0, 0)) -> ActArrays:
    """Return the same action for every lane."""
    return ActArrays(np.tile(np.array(axes, np.float32), (lanes, 1)), np.tile(np.array(choices, np.int32), (lanes, 1)))


def sense(game: ShootingBirds) -> list[Array]:
    """Return the observations of the first arena, one array per sensor."""
    return [values[0] for values in game.observe()[0].observations]


def moves(rays: Array, numbers: Array, k: int) -> Array:
    """Return axes for decision k: now and then a wild sweep, else straight to the nearest bird that the rays meet.

    They depend on the arenas' numbers in the seed and on what they observe, on nothing else.
    """
    distances = np.where(rays[:, :, 0] < 0, np.float32(2), rays[:, :, 0])
    ray, distance = distances.argmin(axis=1), distances.min(axis=1)
    backwards = (ray > 3) & (ray < 9)
    angle = np.where(backwards, ray - 6, np.where(ray < 9, ray, ray - 12)).astype(np.float32) / np.float32(3)
    speed = np.minimum(distance * np.float32(14), np.float32(1)) * np.where(backwards, np.float32(-1), np.float32(1))
    sweep_angle = ((37 * k + 11 * numbers) % 41 - 20).astype(np.float32) / np.float32(20)
    sweep_speed = ((13 * (k // 8) + 5 * numbers) % 41 - 20).astype(np.float32) / np.float32(20)
    sweep = (distance > 1) | ((k // 16 + numbers) % 4 == 0)
    return np.stack([np.where(sweep, sweep_angle, angle), np.where(sweep, sweep_speed, speed)], axis=1)


def play(game: ShootingBirds, steps: int, begin: int = 0) -> Array:
    """Hunt and return all observations and rewards [arenas, steps, values]."""
    numbers = game.first_arena + np.arange(len(game.arenas))
    (step,), rows = game.observe(), []
    for k in range(begin, begin + steps):
        gun, _, rays, hovered = step.observations
        shoot, reload = (hovered[:, 0] == 1) | (k % 8 == 0), (gun[:, 0] == 0) & (k % 16 == 3) | (k % 128 == 0)
        act = ActArrays(moves(rays, numbers, k), np.stack([shoot, reload], axis=1).astype(np.int32))
        (step,) = game.step([act])
        rows.append([*(values.reshape(len(numbers), -1) for values in step.observations), step.rewards])
    return np.stack([np.concatenate(row, axis=1) for row in rows], axis=1)


def saved(game: ShootingBirds) -> dict[str, Array]:
    return {name: values.copy() for name, values in game.save().items()}


def neutral(behavior: Any) -> tuple[tuple[float, ...], tuple[int, ...]]:
    """Return axes and choices that do nothing."""
    return (0.0,) * len(behavior.device.axes), (0,) * len(behavior.device.branches)
