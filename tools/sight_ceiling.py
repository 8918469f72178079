"""The ceiling of Shooting Birds from images: a scripted shooter that gets nothing but what an agent sees.

    python -m tools.sight_ceiling [--arenas N]

The shooter aims at the bird nearest to the pointer and shoots when it sees a bird under it. It reloads when the bar is
empty. On the screen it finds the pointer by its circle, near where its last action must have moved it.
"""

import argparse
from itertools import product

import numpy as np

from joybridge.contract.codec import ActArrays
from joybridge.contract.spec import choose_options
from joybridge.contract.tensors import Array
from joybridge.games.shooting_birds.game import ShootingBirds
from joybridge.games.shooting_birds.picture import CURSOR_RADIUS, HALF_HEIGHT, HALF_WIDTH
from joybridge.games.shooting_birds.rules import EPISODE_TICKS, TICK, TOP_SPEED
from joybridge.games.sight import WIDE_REACH

BIRD = 120  # the darkest shade that only birds have
GROUND = 60  # brighter than sky, trees and barns
FOUND = 13.0  # mean contrast of a circle that is the pointer
CONFIGURATIONS: dict[str, dict[str, str]] = {
    "screen, 48 pixels": {"observation": "screen", "screen_size": "48"},
    "screen, 64 pixels": {"observation": "screen", "screen_size": "64"},
    "screen, 84 pixels": {"observation": "screen", "screen_size": "84"},
    "fovea+wide": {"observation": "fovea+wide"},
}
STEP = TICK * TOP_SPEED  # units that the pointer moves per decision, at most
_ANGLES = np.arange(24) * np.pi / 12
CIRCLE = CURSOR_RADIUS * np.stack([np.cos(_ANGLES), np.sin(_ANGLES)], axis=1)
NEAR = np.array(list(product(np.linspace(-1.2, 1.2, 17), repeat=2)))
EVERYWHERE = np.array(list(product(np.arange(-17.7, 17.8, 0.6), np.arange(-10.2, 10.3, 0.6))))


def shade(images: Array, places: Array, left: float, top: float, unit: float) -> Array:
    """Return the shades [arenas, n] between pixels at places [arenas, n, 2] in units, 0 outside the images."""
    padded = np.pad(images.astype(np.float64), ((0, 0), (1, 1), (1, 1)))
    column = np.clip((places[..., 0] - left) / unit + 0.5, 0, padded.shape[2] - 1.001)
    row = np.clip((top - places[..., 1]) / unit + 0.5, 0, padded.shape[1] - 1.001)
    i, j, arena = row.astype(int), column.astype(int), np.arange(len(images))[:, None]
    below, right = row - i, column - j
    upper = padded[arena, i, j] * (1 - right) + padded[arena, i, j + 1] * right
    lower = padded[arena, i + 1, j] * (1 - right) + padded[arena, i + 1, j + 1] * right
    return np.asarray(upper * (1 - below) + lower * below)


def find_pointer(images: Array, guesses: Array, unit: float) -> tuple[Array, Array]:
    """Return the best of several guesses [arenas, n, 2] where the pointer is [arenas, 2], and whether it is good.

    Around the pointer lies a circle that is brighter than what is just inside and outside it, and darker than birds.
    """

    def shades(scale: float) -> Array:
        points = guesses[:, :, None, :] + scale * CIRCLE
        flat = shade(images, points.reshape(len(images), -1, 2), -HALF_WIDTH, HALF_HEIGHT, unit)
        return flat.reshape(points.shape[:3])

    apart = 1.5 * unit / CURSOR_RADIUS
    circle, inside = shades(1.0), shades(1.0 - apart)
    inside = np.where(inside > GROUND, 0.0, inside)  # a bird that is aimed at
    contrast = np.clip(circle - np.maximum(inside, shades(1.0 + apart)), 0, 25)
    scores = np.where(circle > BIRD, 0.0, contrast).mean(axis=2)
    best = np.argmax(scores, axis=1)
    every = np.arange(len(images))
    return guesses[every, best], scores[every, best] > FOUND


def nearest_bird(images: Array, pointers: Array, left: Array, top: Array, unit: float) -> tuple[Array, Array]:
    """Return the place [arenas, 2] of the bird nearest to the pointer, relative to it, and whether there is one."""
    arenas, height, width = images.shape
    x = left[:, None, None] + unit * (np.arange(width) + 0.5) - pointers[:, 0, None, None]
    y = top[:, None, None] - unit * (np.arange(height)[:, None] + 0.5) - pointers[:, 1, None, None]
    bird = images >= BIRD
    bird[:, height - max(height // 20, 1) :] = False  # the bar
    distance = np.where(bird, np.hypot(x, y), np.inf).reshape(arenas, -1)
    nearest, every = distance.argmin(axis=1), np.arange(arenas)
    x, y = (np.broadcast_to(part, images.shape).reshape(arenas, -1) for part in (x, y))
    seed_x, seed_y = x[every, nearest, None], y[every, nearest, None]
    part = bird.reshape(arenas, -1) & (np.hypot(x - seed_x, y - seed_y) <= max(1.3, 1.1 * unit))
    weight = part * images.reshape(arenas, -1).astype(np.float64)
    total = np.maximum(weight.sum(axis=1), 1.0)
    target = np.stack([(weight * x).sum(axis=1) / total, (weight * y).sum(axis=1) / total], axis=1)
    return target, np.isfinite(distance.min(axis=1))


def play(options: dict[str, str], arenas: int) -> float:
    """Return the mean reward of an episode of so many arenas."""
    chosen = choose_options(ShootingBirds.options, {**options, "locomotion": "axes"}, "shooting_birds")
    game = ShootingBirds(chosen, {}, arenas, 0, 0)
    weights = np.array([channel.default_weight for channel in game.channels])
    (step,), pointers, total, moved = game.observe(), np.zeros((arenas, 2)), np.zeros(arenas), np.zeros((arenas, 2))
    origin = np.zeros((arenas, 2))
    for _ in range(EPISODE_TICKS):
        images = [values[..., 0] for values in step.observations]
        if len(images) == 1:
            unit = 2 * HALF_WIDTH / images[0].shape[2]
            pointers, found = find_pointer(images[0], pointers[:, None] + moved[:, None] + NEAR, unit)
            if not found.all():
                everywhere = np.tile(EVERYWHERE, (int((~found).sum()), 1, 1))
                pointers[~found], _ = find_pointer(images[0][~found], everywhere, unit)
            left, top = np.full(arenas, -HALF_WIDTH), np.full(arenas, HALF_HEIGHT)
            target, seen = nearest_bird(images[0], pointers, left, top, unit)
            under = shade(images[0], pointers[:, None], -HALF_WIDTH, HALF_HEIGHT, unit)[:, 0]
        else:
            fovea, wide = images
            half = float(chosen["fovea_reach"])
            unit = 2 * half / fovea.shape[2]
            target, seen = nearest_bird(fovea, origin, origin[:, 0] - half, origin[:, 1] + half, unit)
            coarse = 2 * WIDE_REACH / wide.shape[2]
            far, seen_far = nearest_bird(wide, origin, origin[:, 0] - WIDE_REACH, origin[:, 1] + WIDE_REACH, coarse)
            target = np.where(seen[:, None], target, np.where(seen_far[:, None], far, 0.0))
            under = shade(fovea, origin[:, None], -half, half, unit)[:, 0]
        empty = images[0][:, -1].max(axis=1) == 0
        moved = np.where(np.abs(target).max(axis=1, keepdims=True) < 1e3, np.clip(target, -STEP, STEP), 0.0)
        shoot, reload = (under >= BIRD) & ~empty, empty
        axes = (moved / STEP).astype(np.float32)
        (step,) = game.step([ActArrays(axes, np.stack([shoot, reload], axis=1).astype(np.int32))])
        total += step.rewards @ weights
    return float(total.mean())


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description="Measure a scripted shooter that sees images.")
    parser.add_argument("--arenas", type=int, default=28, help="episodes per configuration; default %(default)s")
    arenas = parser.parse_args().arenas
    for name, options in CONFIGURATIONS.items():
        print(f"{name}: reward {play(options, arenas):.1f}", flush=True)


if __name__ == "__main__":
    main()
