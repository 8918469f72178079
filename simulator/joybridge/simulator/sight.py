"""Images for agents from the pictures of a game: the whole picture made smaller, and a square around the pointer.

A picture is what `draw` returns, uint8 [height, width, 3], or a surface of pygame. All arithmetic is in whole numbers,
so the images are the same bytes on every machine if the picture is. Declare them with `image(..., centered=...)`.
"""

from typing import TYPE_CHECKING

import numpy as np

from joybridge.contract.tensors import Array

if TYPE_CHECKING:
    import pygame

__all__ = ["fovea", "shrink"]

BEYOND = 20  # shade of what lies outside the picture
LUMINANCE = np.array([77, 150, 29])  # of red, green and blue, in 256ths


def shrink(picture: "Array | pygame.Surface", height: int, width: int, channels: int = 1) -> Array:
    """Return a picture in another size, uint8 [height, width, channels]: each pixel is the mean of what it covers.

    channels: 1 for gray, 3 for RGB.
    """
    pixels = _pixels(picture)
    if channels == 1:
        pixels = (pixels @ LUMINANCE >> 8)[:, :, None]
    rows, columns = _shares(pixels.shape[0], height), _shares(pixels.shape[1], width)
    # The sums are whole numbers below 2^53: floats hold them exactly, in any order of addition.
    down = np.tensordot(rows, pixels.astype(np.float64), 1)
    sums = np.einsum("wx,hxc->hwc", columns, down, optimize=True)
    area = pixels.shape[0] * pixels.shape[1]
    small: Array = ((sums.astype(np.int64) + area // 2) // area).astype(np.uint8)
    return small


def fovea(picture: "Array | pygame.Surface", x: float, y: float, reach: int, size: int, channels: int = 1) -> Array:
    """Return the square around a point of a picture, uint8 [size, size, channels].

    x, y: pixels from the left and from the top. reach: pixels from the point to the edges of the square. What lies
    beyond the picture is dark gray.
    """
    pixels = _pixels(picture)
    height, width = pixels.shape[:2]
    square = np.full((2 * reach, 2 * reach, 3), BEYOND, np.uint8)
    left, top = round(x) - reach, round(y) - reach
    across, down = (slice(max(low, 0), min(low + 2 * reach, most)) for low, most in ((left, width), (top, height)))
    if across.start < across.stop and down.start < down.stop:
        square[down.start - top : down.stop - top, across.start - left : across.stop - left] = pixels[down, across]
    return shrink(square, size, size, channels)


def _pixels(picture: "Array | pygame.Surface") -> Array:
    if isinstance(picture, np.ndarray):
        return picture
    import pygame

    return pygame.surfarray.array3d(picture).swapaxes(0, 1)


def _shares(many: int, few: int) -> Array:
    """Return how much of each old pixel each new one covers, in 1 / few: whole numbers, float64 [few, many]."""
    begin, old = np.arange(few)[:, None] * many, np.arange(many) * few
    shares: Array = np.clip(np.minimum(begin + many, old + few) - np.maximum(begin, old), 0, None).astype(np.float64)
    return shares
