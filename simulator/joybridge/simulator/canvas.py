"""Small images for agents, painted shape by shape in microseconds by compiled code.

What `draw` shows a person takes milliseconds, and an agent sees some hundred pixels of it, which a game paints itself:

    canvas = Canvas(BACKGROUND, left=0.0, top=1.0, unit=1 / 48)
    canvas.disc((x, y), radius, (226, 62, 74))
    return {"screen": canvas.pixels}

A shade is the share of a pixel that is covered, so that it shows positions within a pixel. It is a whole number; the
floats before it use only operations that IEEE 754 defines exactly, so the images are the same bytes on every machine.
"""

import math
from collections.abc import Sequence

import numpy as np

from joybridge.contract.tensors import Array
from joybridge.simulator.compiled import compiled

__all__ = ["Canvas"]

Place = Sequence[float] | Array  # x, y


class Canvas:
    """An image that shapes are painted on, in units of the game, y up. What lies beyond it is cut off.

    A color is a shade for each channel, 0 to 255. Methods raise ValueError for other counts.
    """

    pixels: Array  # uint8 [height, width, channels]

    def __init__(self, background: Array, left: float, top: float, unit: float) -> None:
        """Begin with a copy of a background, uint8 [height, width, channels], with 1 channel for gray or 3 for RGB.

        left, top: of the edges of the image, in units of the game. unit: how many of these a pixel is wide.
        Raises ValueError for another background.
        """
        if background.ndim != 3 or background.dtype != np.uint8 or background.shape[2] not in (1, 3):
            raise ValueError(
                f"background: got {background.dtype} {list(background.shape)}, expected uint8 [height, width, 1 or 3]"
            )
        self.pixels = background.copy()
        self._left, self._top, self._unit = float(left), float(top), float(unit)

    def disc(self, center: Place, radius: float, color: Sequence[int]) -> None:
        """Paint a disc."""
        self.line(center, center, 2 * radius, color)

    def ring(self, center: Place, radius: float, width: float, color: Sequence[int]) -> None:
        """Paint a circle whose line is `width` wide, half of it beyond the radius."""
        half = float(width) / 2 / self._unit
        _paint_ring(self.pixels, *self._pixel(*center), float(radius) / self._unit, half, *self._shades(color))

    def line(self, begin: Place, end: Place, width: float, color: Sequence[int]) -> None:
        """Paint a line with round ends."""
        ends = *self._pixel(*begin), *self._pixel(*end)
        _paint_line(self.pixels, *ends, float(width) / 2 / self._unit, *self._shades(color))

    def box(self, left: float, bottom: float, right: float, top: float, color: Sequence[int]) -> None:
        """Paint a box with upright edges."""
        corners = *self._pixel(left, top), *self._pixel(right, bottom)
        _paint_box(self.pixels, *corners, *self._shades(color))

    def _pixel(self, x: float, y: float) -> tuple[float, float]:
        """Return the column and the row of a place; whole numbers are the middles of pixels."""
        return (float(x) - self._left) / self._unit - 0.5, (self._top - float(y)) / self._unit - 0.5

    def _shades(self, color: Sequence[int]) -> tuple[int, int, int]:
        """Return three numbers whatever the channels, so that there is one machine code for all."""
        if len(color) != self.pixels.shape[2]:
            raise ValueError(f"color: got {color}, expected a shade for each of {self.pixels.shape[2]} channels")
        return color[0], color[-2] if len(color) > 1 else 0, color[-1]


@compiled
def _paint_line(pixels, x0, y0, x1, y1, half, red, green, blue):
    """Paint what is up to `half` away from the line between two places, in pixels; a disc if they are the same."""
    height, width, _ = pixels.shape
    reach, along_x, along_y = half + 0.5, x1 - x0, y1 - y0
    squared = along_x * along_x + along_y * along_y
    for i in range(max(math.ceil(min(y0, y1) - reach), 0), min(math.floor(max(y0, y1) + reach) + 1, height)):
        for j in range(max(math.ceil(min(x0, x1) - reach), 0), min(math.floor(max(x0, x1) + reach) + 1, width)):
            share = 0.0
            if squared > 0.0:
                share = min(max(((j - x0) * along_x + (i - y0) * along_y) / squared, 0.0), 1.0)
            x, y = j - (x0 + share * along_x), i - (y0 + share * along_y)
            _blend(pixels, i, j, reach - math.sqrt(x * x + y * y), red, green, blue)


@compiled
def _paint_ring(pixels, x, y, radius, half, red, green, blue):
    """Paint what is up to `half` away from a circle, in pixels."""
    height, width, _ = pixels.shape
    reach = radius + half + 0.5
    for i in range(max(math.ceil(y - reach), 0), min(math.floor(y + reach) + 1, height)):
        for j in range(max(math.ceil(x - reach), 0), min(math.floor(x + reach) + 1, width)):
            away = abs(math.sqrt((j - x) * (j - x) + (i - y) * (i - y)) - radius)
            _blend(pixels, i, j, half + 0.5 - away, red, green, blue)


@compiled
def _paint_box(pixels, left, top, right, bottom, red, green, blue):
    """Paint a box, in pixels."""
    height, width, _ = pixels.shape
    for i in range(max(math.ceil(top - 0.5), 0), min(math.floor(bottom + 0.5) + 1, height)):
        high = min(bottom, i + 0.5) - max(top, i - 0.5)
        for j in range(max(math.ceil(left - 0.5), 0), min(math.floor(right + 0.5) + 1, width)):
            wide = min(right, j + 0.5) - max(left, j - 0.5)
            _blend(pixels, i, j, max(high, 0.0) * max(wide, 0.0), red, green, blue)


@compiled
def _blend(pixels, i, j, cover, red, green, blue):
    """Mix a color into a pixel of which `cover` is covered: nothing below 0, all from 1."""
    share = int(min(max(cover, 0.0), 1.0) * 256)
    for c in range(pixels.shape[2]):
        old, new = int(pixels[i, j, c]), red if c == 0 else green if c == 1 else blue
        pixels[i, j, c] = old + ((new - old) * share >> 8)
