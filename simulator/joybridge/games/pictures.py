"""Images of a field, drawn from the arrays of many arenas by compiled code: what an agent with eyes observes.

An `Eye` looks at the whole field, or at a square around the pointer. What never moves is filtered once, for each level,
and copied; what moves is painted over it. A shade is the share of a pixel that is covered, so that it shows positions
within a pixel. All shades are integers; the floats before them use only operations that IEEE 754 defines exactly.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from joybridge.contract.tensors import Array
from joybridge.simulator.compiled import compiled

PHASES = 4  # positions within a pixel, per direction, in which the background of a moving eye is filtered
SAMPLES = 4  # per pixel and direction, of which the background is the mean


class Palette(NamedTuple):
    """The shades of a gray image, one number each, or the colors of an RGB image, three."""

    ground: Sequence[int | tuple[int, int, int]]  # per kind of ground
    things: Sequence[int | tuple[int, int, int]]  # as the painter of the game numbers them


@dataclass(frozen=True, eq=False)
class Field:
    """What never moves: kinds of ground, such as sky and trees, some of which hide some of the things that move."""

    half_width: float  # of the rectangle that a whole picture shows, in units of the game
    half_height: float
    levels: int
    ground: Callable[[int, Array, Array], Array]  # (level, x [w], y [h]) -> kind of ground, uint8 [h, w]
    hides: Array  # bool [kinds of things, kinds of ground]
    gray: Palette
    rgb: Palette


@dataclass(frozen=True)
class View:
    """How an eye looks at a field."""

    height: int  # pixels
    width: int
    unit: float  # units of the game per pixel
    channels: int  # 1 gray, 3 RGB
    centered: bool  # on the pointer; otherwise on the field


class Eye(NamedTuple):
    """A view with everything that compiled code needs. Planes hold the background at each phase within a pixel."""

    background: Array  # uint8 [levels, phases, phases, rows, columns, channels]
    hidden: Array  # uint8 [levels, phases, phases, rows, columns, kinds]: share of a pixel that hides things of a kind
    colors: Array  # int64 [things, channels]
    left: float  # edges of the planes, units
    top: float
    unit: float
    centered: bool


class Window(NamedTuple):
    """What an eye sees of its planes in one arena."""

    hidden: Array  # uint8 [rows, columns, kinds]
    row: int  # of the first pixel
    column: int
    left: float  # edges of the image, units
    top: float


@lru_cache(maxsize=8)
def open_eye(view: View, field: Field) -> Eye:
    """Return the eye of a view, with its backgrounds, which are filtered once in a process."""
    palette = field.gray if view.channels == 1 else field.rgb
    ground_colors, colors = (np.reshape(part, (-1, view.channels)).astype(np.int64) for part in palette)
    half_x, half_y, phases = view.width * view.unit / 2, view.height * view.unit / 2, 1
    rows, columns = view.height, view.width
    if view.centered:  # planes reach as far as the eye does from any place in the field
        phases = PHASES
        half_x, half_y = half_x + field.half_width, half_y + field.half_height
        rows, columns = (math.ceil(2 * half / view.unit) + 1 for half in (half_y, half_x))
    fine = view.unit / SAMPLES
    x = -half_x + fine * (np.arange((columns + 1) * SAMPLES) + 0.5)
    y = half_y - fine * (np.arange((rows + 1) * SAMPLES) + 0.5)
    size = (field.levels, phases, phases, rows, columns)
    background = np.empty((*size, view.channels), np.uint8)
    hidden = np.empty((*size, len(field.hides)), np.uint8)
    for level in range(field.levels):
        ground = field.ground(level, x, y)
        shares = np.stack([_filter(ground == kind, phases) for kind in range(len(ground_colors))], axis=-1)
        background[level] = (shares @ ground_colors + SAMPLES**2 // 2) // SAMPLES**2
        hidden[level] = shares @ (255 * field.hides.T.astype(np.int64)) // SAMPLES**2
    return Eye(background, hidden, colors, -half_x, half_y, view.unit, view.centered)


def _filter(covered: Array, phases: int) -> Array:
    """Return how many samples of each pixel are covered, int64 [phases, phases, rows, columns]."""
    height, width = covered.shape
    sums = np.zeros((height + 1, width + 1), np.int64)
    sums[1:, 1:] = covered.cumsum(axis=0, dtype=np.int64).cumsum(axis=1)
    step, last = SAMPLES // phases, -SAMPLES
    counts = (
        sums[SAMPLES:, SAMPLES:] - sums[:last, SAMPLES:] - sums[SAMPLES:, :last] + sums[:last, :last]
    )  # of the pixel that begins at a sample
    rows, columns = height // SAMPLES - 1, width // SAMPLES - 1
    starts = [
        np.arange(phase * step, phase * step + SAMPLES * n, SAMPLES) for n in (rows, columns) for phase in range(phases)
    ]
    return np.stack([np.stack([counts[np.ix_(r, c)] for c in starts[phases:]]) for r in starts[:phases]])


@compiled
def copy_background(eye, level, x, y, canvas):
    """Copy what the eye sees of a level with the pointer at (x, y) to `canvas` [height, width, channels]."""
    height, width, channels = canvas.shape
    row, column, phase_y, phase_x, left, top = 0, 0, 0, 0, eye.left, eye.top
    if eye.centered:
        left, top = x - 0.5 * width * eye.unit, y + 0.5 * height * eye.unit
        phases = eye.background.shape[1]
        across = _steps((left - eye.left) / eye.unit, phases, eye.background.shape[4] - width)
        down = _steps((eye.top - top) / eye.unit, phases, eye.background.shape[3] - height)
        column, phase_x = across // phases, across % phases
        row, phase_y = down // phases, down % phases
    plane = eye.background[level, phase_y, phase_x]
    for i in range(height):
        for j in range(width):
            for c in range(channels):
                canvas[i, j, c] = plane[row + i, column + j, c]
    return Window(eye.hidden[level, phase_y, phase_x], row, column, left, top)


@compiled
def _steps(pixels, phases, most):
    """Return a distance in phases, rounded, within 0..most pixels."""
    return math.floor(min(max(pixels, 0.0), float(most)) * phases + 0.5)


@compiled
def paint_disc(eye, window, kind, x, y, radius, color, opacity, canvas):
    """Paint a disc at (x, y), units, behind what hides things of its kind. opacity: 0..256."""
    cx, cy, r = (x - window.left) / eye.unit - 0.5, (window.top - y) / eye.unit - 0.5, radius / eye.unit
    height, width, channels = canvas.shape
    reach = r + 0.5
    for i in range(max(math.ceil(cy - reach), 0), min(math.floor(cy + reach) + 1, height)):
        for j in range(max(math.ceil(cx - reach), 0), min(math.floor(cx + reach) + 1, width)):
            cover = reach - math.sqrt((j - cx) * (j - cx) + (i - cy) * (i - cy))
            if cover > 0.0:
                seen = 255 - int(window.hidden[window.row + i, window.column + j, kind])
                share = int(min(cover, 1.0) * opacity) * seen // 255
                for c in range(channels):
                    old = int(canvas[i, j, c])
                    canvas[i, j, c] = old + ((eye.colors[color, c] - old) * share >> 8)


@compiled
def paint_ring(eye, window, x, y, radius, color, opacity, canvas):
    """Paint a circle around (x, y), a pixel wide, in front of everything. Radius in units."""
    cx, cy, r = (x - window.left) / eye.unit - 0.5, (window.top - y) / eye.unit - 0.5, radius / eye.unit
    height, width, channels = canvas.shape
    reach = r + 1.0
    for i in range(max(math.ceil(cy - reach), 0), min(math.floor(cy + reach) + 1, height)):
        for j in range(max(math.ceil(cx - reach), 0), min(math.floor(cx + reach) + 1, width)):
            cover = 1.0 - abs(r - math.sqrt((j - cx) * (j - cx) + (i - cy) * (i - cy)))
            if cover > 0.0:
                share = int(cover * opacity)
                for c in range(channels):
                    old = int(canvas[i, j, c])
                    canvas[i, j, c] = old + ((eye.colors[color, c] - old) * share >> 8)


@compiled
def paint_bar(eye, begin, end, share, color, canvas):
    """Paint a bar into columns begin..end of the lowest rows, a share of it filled and the rest black."""
    height, _, channels = canvas.shape
    filled = begin + share * (end - begin)
    for i in range(height - max(height // 20, 1), height):
        for j in range(begin, end):
            cover = int(min(max(filled - j, 0.0), 1.0) * 256)
            for c in range(channels):
                canvas[i, j, c] = eye.colors[color, c] * cover >> 8
