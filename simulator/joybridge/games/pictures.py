"""Images of a field, drawn from the arrays of many arenas by compiled code: what an agent with eyes observes.

An `Eye` looks at the whole field, or at a square around the pointer. What never moves is filtered once, for each level,
and copied; what moves is painted over it. A shade is the share of a pixel that is covered, so that it shows positions
within a pixel. All shades are integers; the floats before them use only operations that IEEE 754 defines exactly.
"""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from joybridge.contract.tensors import Array
from joybridge.simulator.compiled import compiled

PHASES = 4  # positions within a pixel, per direction, in which the background of a moving eye is filtered
SAMPLES = 4  # per pixel and direction, of which the background is the mean
TIE = 1e-6  # pixels
COUNT_BITS = 8  # of a number of samples, which is at most SAMPLES * SAMPLES
COUNT_MASK = 2**COUNT_BITS - 1


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
    on_camera: bool = False  # if not on the pointer: on a camera that moves over the field
    rounded: bool = False  # what it sees is moved to whole pixels


class Eye(NamedTuple):
    """A view with everything that compiled code needs. Planes hold the background at each phase within a pixel."""

    background: Array  # uint8 [levels, phases, phases, rows, columns, channels]
    hidden: Array  # uint8 [levels, phases, phases, rows, columns, kinds]: share of a pixel that hides things of a kind
    ground_colors: Array  # int64 [kinds of ground, channels]
    colors: Array  # int64 [things, channels]
    left: float  # edges of the planes, units
    top: float
    unit: float
    centered: bool  # on a place that moves
    on_camera: bool  # and that is not the pointer
    rounded: bool


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
    eye = make_eye(view, field)
    look(eye, field, range(field.levels))
    return eye


def make_eye(view: View, field: Field) -> Eye:
    """Return the eye of a view, still without what it sees of the ground: see `look`."""
    palette = field.gray if view.channels == 1 else field.rgb
    ground_colors, colors = (np.reshape(part, (-1, view.channels)).astype(np.int64) for part in palette)
    half_x, half_y, phases = view.width * view.unit / 2, view.height * view.unit / 2, 1
    rows, columns = view.height, view.width
    moves = view.centered or view.on_camera
    if moves:  # planes reach as far as the eye does from any place in the field
        phases = 1 if view.rounded else PHASES
        half_x, half_y = half_x + field.half_width, half_y + field.half_height
        rows, columns = (math.ceil(2 * half / view.unit) + 1 for half in (half_y, half_x))
    size = (field.levels, phases, phases, rows, columns)
    background = np.empty((*size, view.channels), np.uint8)
    hidden = np.empty((*size, len(field.hides)), np.uint8)
    return Eye(
        background, hidden, ground_colors, colors, -half_x, half_y, view.unit, moves, view.on_camera, view.rounded
    )


def look(eye: Eye, field: Field, levels: Iterable[int]) -> None:
    """Filter what the eye sees of the ground of some levels of the field."""
    rows, columns = eye.background.shape[3:5]
    fine = eye.unit / SAMPLES
    x = eye.left + fine * (np.arange((columns + 1) * SAMPLES) + 0.5)
    y = eye.top - fine * (np.arange((rows + 1) * SAMPLES) + 0.5)
    for level in levels:
        _filter(field.ground(level, x, y), eye.ground_colors, field.hides, eye.background[level], eye.hidden[level])


@compiled
def _filter(ground, colors, hides, background, hidden):
    """Write the mean color of each pixel, and the share of it that hides things of each kind, at every phase.

    ground: a kind per sample. colors: [kinds of ground, channels]. hides: [kinds of things, kinds of ground].
    """
    phases, _, rows, columns, channels = background.shape
    step, samples = SAMPLES // phases, SAMPLES * SAMPLES
    counts = _count(ground)
    for phase_y in range(phases):
        for phase_x in range(phases):
            for row in range(rows):
                for column in range(columns):
                    packed = counts[row * SAMPLES + phase_y * step, column * SAMPLES + phase_x * step]
                    for c in range(channels):
                        total = samples // 2
                        for kind in range(len(colors)):
                            total += (packed >> COUNT_BITS * kind & COUNT_MASK) * colors[kind, c]
                        background[phase_y, phase_x, row, column, c] = total // samples
                    for thing in range(len(hides)):
                        covered = 0
                        for kind in range(len(colors)):
                            covered += packed >> COUNT_BITS * kind & COUNT_MASK if hides[thing, kind] else 0
                        hidden[phase_y, phase_x, row, column, thing] = 255 * covered // samples


@compiled
def _count(ground):
    """Return how many samples of each kind the pixel has that begins at a sample, packed into int64 [height, width].

    The count of each kind takes `COUNT_BITS`, so that all are added at once: first along x, then along y.
    """
    height, width = ground.shape
    along = np.zeros((height, width), np.int64)
    for i in range(height):
        for j in range(width - SAMPLES + 1):
            for k in range(SAMPLES):
                along[i, j] += 1 << COUNT_BITS * int(ground[i, j + k])
    counts = np.zeros((height, width), np.int64)
    for i in range(height - SAMPLES + 1):
        for k in range(SAMPLES):
            for j in range(width):
                counts[i, j] += along[i + k, j]
    return counts


@compiled
def copy_background(eye, level, x, y, canvas):
    """Copy what the eye sees of a level around (x, y) to `canvas` [height, width, channels]."""
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
def _pixel(eye, window, x, y):
    """Return where in an image the place (x, y) is, in pixels; 0 is the middle of the first one."""
    column, row = (x - window.left) / eye.unit - 0.5, (window.top - y) / eye.unit - 0.5
    if eye.rounded:  # what is half way goes to the same pixel with each rounding error
        column, row = math.floor(column + 0.5 + TIE) + 0.0, math.floor(row + 0.5 + TIE) + 0.0
    return column, row


@compiled
def paint_disc(eye, window, kind, x, y, radius, color, opacity, canvas):
    """Paint a disc at (x, y), units, behind what hides things of its kind. opacity: 0..256."""
    (cx, cy), r = _pixel(eye, window, x, y), radius / eye.unit
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
    (cx, cy), r = _pixel(eye, window, x, y), radius / eye.unit
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
