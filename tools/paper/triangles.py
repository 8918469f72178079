"""Whether a path goes around on triangles: laps, their convex hulls, and what encloses these most tightly.

A hull that nearly fills its smallest enclosing triangle is a triangle. So that "nearly" needs no number, a lap counts
as a triangle if this triangle is smaller than the smallest enclosing parallelogram. Neither stretching nor shearing a
lap changes the answer. A triangle fills half of a parallelogram, and a parallelogram half of a triangle; a circle and
any ellipse fill 60 % of their triangle and 79 % of their parallelogram, and half a disc fills 78 % of both.
"""

from collections.abc import Iterator
from functools import cache
from itertools import combinations

import numpy as np
from scipy.ndimage import uniform_filter1d
from scipy.spatial import ConvexHull, QhullError

from joybridge.contract.tensors import Array

AROUND_SECONDS = 7.0  # over which the center of a lap is the mean of the path: two laps or more


def laps(path: Array, seconds: float) -> Iterator[Array]:
    """Yield the laps of a path [decisions, 2], its whole turns around its moving center. seconds: of a decision."""
    window = round(AROUND_SECONDS / seconds)
    if len(path) < window:
        return
    x, y = (path - uniform_filter1d(path, window, axis=0, mode="nearest")).T
    angle, first = np.unwrap(np.arctan2(y, x)), 0
    for last in range(len(path)):
        if abs(angle[last] - angle[first]) >= 2 * np.pi:
            yield path[first : last + 1]
            first = last


def is_triangle(lap: Array) -> bool | None:
    """Return whether the hull of a lap [decisions, 2] fills a triangle better than a parallelogram; None for a line."""
    try:
        hull = ConvexHull(lap)
    except QhullError:
        return None
    x, y = hull.equations[:, :2].T
    angles = np.unique(np.round(np.arctan2(y, x), 6))  # of the normals of its sides
    along = lap[hull.vertices] @ np.stack([np.cos(angles), np.sin(angles)])
    return bool(_triangle(angles, along.max(axis=0)) < _parallelogram(angles, np.ptp(along, axis=0)))


def _triangle(angles: Array, reach: Array) -> float:
    """Return the smallest area of a triangle on three sides of a hull, infinite if there is none.

    angles: of the sides' normals, ascending. reach: how far the hull reaches along each.
    """
    a, b, c = _choose(len(angles), 3)
    ab, bc, ca = (np.sin(angles[q] - angles[p]) for p, q in ((a, b), (b, c), (c, a)))
    closed = np.minimum(np.minimum(ab, bc), ca) > 1e-6  # each normal is less than half a turn from the next
    a, b, c, ab, bc, ca = (each[closed] for each in (a, b, c, ab, bc, ca))
    areas = np.square(reach[a] * bc + reach[b] * ca + reach[c] * ab) / (2 * ab * bc * ca)
    return float(areas.min(initial=np.inf))


def _parallelogram(angles: Array, widths: Array) -> float:
    """Return the smallest area of a parallelogram on sides of a hull. widths: of the hull along each normal."""
    a, b = _choose(len(angles), 2)
    sine = abs(np.sin(angles[a] - angles[b]))
    return float((widths[a] * widths[b] / np.maximum(sine, 1e-9)).min())  # parallel sides enclose nothing


@cache
def _choose(number: int, few: int) -> Array:
    """Return all ways to choose so few of a number of indices, int [few, ways]."""
    return np.array(list(combinations(range(number), few)), int).T
