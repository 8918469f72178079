"""The four nearest birds, as a person sees them: a sensor that the option `nearest_birds` adds to the rays.

Rays are thirty degrees apart and tell neither how birds fly nor where those between two rays are.
"""

import numpy as np

from joybridge.games.shooting_birds.camera import HALF_X, HALF_Y
from joybridge.games.shooting_birds.sensing import SIZE_CODE, covered
from joybridge.simulator import option, sensor
from joybridge.simulator.compiled import compiled

COUNT = 4
LARGEST = 10.0  # of the sensor's values: what is above it, as a very fast bird that dodges, is cut
UNIT = 10.0  # of the sensor's places and velocities, so that their values are about 1: units, units/s
PARTS = ["seen", "x", "y", "velocity x", "velocity y", "size"]

OPTION = option(
    "nearest_birds",
    ["hidden", "shown"],
    description="whether a sensor tells where the four nearest birds are that nothing covers, and how they fly",
)
SENSOR = sensor(
    "nearest_birds",
    [COUNT, len(PARTS)],
    -LARGEST,
    LARGEST,
    "the four nearest birds on the screen whose middle nothing covers, nearest first, relative to the crosshair; in "
    "tens of units and of units/s; zeros if there are fewer",
    elements=[f"{what} {place}" for place in range(1, COUNT + 1) for what in PARTS],
)


@compiled
def write_nearest(arenas, world, birds):
    """Write the nearest birds of every arena into `birds` [arenas, COUNT, parts]."""
    birds[:] = 0.0
    for i in range(len(arenas)):
        arena = arenas[i]
        distances = np.full(len(arena.birds), np.inf)
        for j in range(len(arena.birds)):
            bird = arena.birds[j]
            on_screen = bird.wait == 0 and abs(bird.x - arena.camera) <= HALF_X and abs(bird.y) <= HALF_Y
            if on_screen and not covered(bird.x, bird.y, bird.z, arena.level, world.obstacles):
                distances[j] = (bird.x - arena.x) ** 2 + (bird.y - arena.y) ** 2
        for place in range(COUNT):
            nearest = np.argmin(distances)
            if distances[nearest] == np.inf:
                break
            distances[nearest] = np.inf
            bird = arena.birds[nearest]
            birds[i, place, 0] = 1.0
            birds[i, place, 1], birds[i, place, 2] = (bird.x - arena.x) / UNIT, (bird.y - arena.y) / UNIT
            birds[i, place, 3] = min(max(bird.vx / UNIT, -LARGEST), LARGEST)
            birds[i, place, 4] = min(max(bird.vy / UNIT, -LARGEST), LARGEST)
            birds[i, place, 5] = SIZE_CODE[bird.kind]
