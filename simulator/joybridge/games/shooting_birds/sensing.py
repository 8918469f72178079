"""Sensors of the crosshair: what is in front under it, and twelve rays."""

import math

import numpy as np

from joybridge.simulator.compiled import compiled

RAYS = 12
RAY_LENGTH = 14.0
BIRD_RADIUS = np.array([1.26, 0.84, 0.42])  # large, medium, small
SIZE_CODE = np.array([0.0, 0.5, 1.0])  # what a ray reports as a bird's size
ABSENT = -1.0  # what a ray reports if it hits nothing
NOTHING, OBSTACLE = -1, -2  # what `front` returns if it is not a bird

# Counter-clockwise from +x in steps of 30 degrees. From exact values, so they are the same on every machine.
_C = math.sqrt(3.0) / 2.0
RAY_X = np.array([1.0, _C, 0.5, 0.0, -0.5, -_C, -1.0, -_C, -0.5, 0.0, 0.5, _C])
RAY_Y = np.array([0.0, 0.5, _C, 1.0, _C, 0.5, 0.0, -0.5, -_C, -1.0, -_C, -0.5])


@compiled
def front(arena, obstacles):
    """Return what is in front at the crosshair's center: a bird's index, OBSTACLE or NOTHING.

    Of all colliders that contain the center, the one with the lowest depth is in front. Large birds fly in front of
    everything, medium ones behind barns, small ones behind barns and trees.
    """
    found, depth = NOTHING, np.inf
    for j in range(len(arena.birds)):
        bird = arena.birds[j]
        dx, dy = bird.x - arena.x, bird.y - arena.y
        radius = BIRD_RADIUS[bird.kind]
        if bird.z < depth and dx * dx + dy * dy <= radius * radius:
            found, depth = j, bird.z
    return OBSTACLE if covered(arena.x, arena.y, depth, arena.level, obstacles) else found


@compiled
def covered(x, y, z, level, obstacles):
    """Return whether an obstacle of a level that is nearer than depth z contains the point (x, y)."""
    for j in range(obstacles.box_count[level]):
        box = obstacles.boxes[level, j]
        if box[4] < z and box[0] <= x <= box[2] and box[1] <= y <= box[3]:
            return True
    for j in range(obstacles.disc_count[level]):
        disc = obstacles.discs[level, j]
        dx, dy = disc[0] - x, disc[1] - y
        if disc[3] < z and dx * dx + dy * dy <= disc[2] * disc[2]:
            return True
    return False


@compiled
def cast_rays(arena, obstacles, rays):
    """Write what the twelve rays hit into `rays` [12, 3].

    Per ray: distance to the nearest bird, size code of that bird, distance to the nearest obstacle. Distances are
    fractions of the ray's length; ABSENT if nothing is hit. Birds and obstacles do not hide each other. A ray that
    starts inside a collider reports distance 0.
    """
    _cast_at_birds(arena, rays)
    distance = np.full(RAYS, np.inf)
    level = arena.level
    for j in range(obstacles.box_count[level]):
        box = obstacles.boxes[level, j]
        _cast_at_box(box[0] - arena.x, box[1] - arena.y, box[2] - arena.x, box[3] - arena.y, distance)
    for j in range(obstacles.disc_count[level]):
        disc = obstacles.discs[level, j]
        _cast_at_disc(disc[0] - arena.x, disc[1] - arena.y, disc[2], distance)
    for k in range(RAYS):
        rays[k, 2] = distance[k] / RAY_LENGTH if distance[k] <= RAY_LENGTH else ABSENT


@compiled
def _cast_at_birds(arena, rays):
    """Write distance and size code of birds. Of several at the same distance (0 inside them), the front one counts."""
    nearest, depth, size = np.full(RAYS, np.inf), np.full(RAYS, np.inf), np.zeros(RAYS)
    distance = np.empty(RAYS)
    for bird in arena.birds:
        distance[:] = np.inf
        _cast_at_disc(bird.x - arena.x, bird.y - arena.y, BIRD_RADIUS[bird.kind], distance)
        for k in range(RAYS):
            if distance[k] < nearest[k] or (distance[k] == nearest[k] and bird.z < depth[k]):
                nearest[k], depth[k], size[k] = distance[k], bird.z, SIZE_CODE[bird.kind]
    for k in range(RAYS):
        met = nearest[k] <= RAY_LENGTH
        rays[k, 0] = nearest[k] / RAY_LENGTH if met else ABSENT
        rays[k, 1] = size[k] if met else ABSENT


@compiled
def _cast_at_disc(dx, dy, radius, distance):
    """Reduce `distance` [12] to the distance of a disc, if nearer. (dx, dy): its center relative to the rays' start."""
    apart = dx * dx + dy * dy - radius * radius
    if apart <= 0.0:
        distance[:] = 0.0
        return
    if dx * dx + dy * dy > (RAY_LENGTH + radius) * (RAY_LENGTH + radius):
        return
    for k in range(RAYS):
        along = dx * RAY_X[k] + dy * RAY_Y[k]
        square = along * along - apart
        if along > 0.0 and square >= 0.0:
            distance[k] = min(distance[k], along - math.sqrt(square))


@compiled
def _cast_at_box(left, bottom, right, top, distance):
    """Reduce `distance` [12] to the distance of a box, if nearer. Its edges are relative to the rays' start."""
    apart_x, apart_y = max(left, 0.0, -right), max(bottom, 0.0, -top)
    if apart_x * apart_x + apart_y * apart_y > RAY_LENGTH * RAY_LENGTH:
        return
    for k in range(RAYS):
        enter, leave = 0.0, np.inf
        for low, high, step in ((left, right, RAY_X[k]), (bottom, top, RAY_Y[k])):
            if step == 0.0:
                if low > 0.0 or high < 0.0:
                    enter = np.inf
            else:
                near, far = low / step, high / step
                enter, leave = max(enter, min(near, far)), min(leave, max(near, far))
        if enter <= leave:
            distance[k] = min(distance[k], enter)
