"""The pitch, which is a polygon with 24 corners, and directions."""

import math

import numpy as np

from joybridge.simulator.compiled import compiled

SEATS = np.array(
    [(0.0, 25.0), (24.5, 19.5), (35.0, 0.0), (24.5, -19.5), (0.0, -25.0), (-24.5, -19.5), (-35.0, 0.0), (-24.5, 19.5)]
)

# Corners of the walkable ground in the quadrant x, z >= 0; the others are its mirror images. At two of them, it is not
# convex.
CORNERS = np.array([(0, 224), (79, 224), (119, 190), (164, 190), (235, 132), (235, 97), (278, 63), (278, 0)]) / 6
# Every point with |x| and |z| up to those of one of these corners is inside.
WIDE_X, WIDE_Z = float(CORNERS[5, 0]), float(CORNERS[5, 1])
TALL_X, TALL_Z = float(CORNERS[3, 0]), float(CORNERS[3, 1])


@compiled
def inside(x, z):
    """Return whether a point is on the walkable ground."""
    x, z = abs(x), abs(z)
    if (x <= WIDE_X and z <= WIDE_Z) or (x <= TALL_X and z <= TALL_Z):
        return True
    height = -1.0
    for k in range(len(CORNERS) - 1):
        ax, az, bx, bz = CORNERS[k, 0], CORNERS[k, 1], CORNERS[k + 1, 0], CORNERS[k + 1, 1]
        if ax <= x <= bx:
            height = max(height, az if bx == ax else az + (bz - az) * (x - ax) / (bx - ax))
    return z <= height


@compiled
def project(x, z):
    """Return the nearest walkable point (x, z)."""
    if inside(x, z):
        return x, z
    px, pz, nearest, near_x, near_z = abs(x), abs(z), np.inf, 0.0, 0.0
    for k in range(len(CORNERS) - 1):
        ax, az = CORNERS[k, 0], CORNERS[k, 1]
        ex, ez = CORNERS[k + 1, 0] - ax, CORNERS[k + 1, 1] - az
        along = min(max(((px - ax) * ex + (pz - az) * ez) / (ex * ex + ez * ez), 0.0), 1.0)
        qx, qz = ax + along * ex, az + along * ez
        square = (px - qx) * (px - qx) + (pz - qz) * (pz - qz)
        if square < nearest:
            nearest, near_x, near_z = square, qx, qz
    return math.copysign(near_x, x), math.copysign(near_z, z)


@compiled
def length(x, z):
    """Return the length of a vector."""
    return math.sqrt(x * x + z * z)


@compiled
def unit(x, z, else_x, else_z):
    """Return the direction of a vector, or another one if it has no length."""
    size = length(x, z)
    if size > 1e-9:
        return x / size, z / size
    return else_x, else_z


@compiled
def turn(fx, fz, ux, uz, cosine, sine):
    """Turn the direction f towards u by at most an angle of 0..180°, given by its cosine and sine.

    Returns the new direction (x, z), and cosine and sine of the turn.
    """
    c, s = fx * ux + fz * uz, fx * uz - fz * ux
    if c >= cosine:
        return ux, uz, c, s
    if s < 0.0:
        sine = -sine
    x, z = unit(fx * cosine - fz * sine, fz * cosine + fx * sine, fx, fz)
    return x, z, cosine, sine
