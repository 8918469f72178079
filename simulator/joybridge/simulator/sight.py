"""Images for agents from the pictures of a game: the whole picture made smaller, and a square around the pointer.

A picture is what `draw` returns, uint8 [height, width, 3], or a surface of pygame. All arithmetic is in whole numbers,
so the images are the same bytes on every machine if the picture is. Declare them with `image(..., centered=...)`.
"""

from typing import TYPE_CHECKING

import numpy as np

from joybridge.contract.tensors import Array

if TYPE_CHECKING:
    import pygame

__all__ = ["fovea", "gray", "shrink"]

BEYOND = 20  # shade of what lies outside the picture
LUMINANCE = (77, 150, 29)  # of red, green and blue, in 256ths, as in ITU-R BT.601


def shrink(picture: "Array | pygame.Surface", height: int, width: int, channels: int = 1) -> Array:
    """Return a picture in another size, uint8 [height, width, channels]: each pixel is the mean of what it covers.

    channels: 1 for gray, 3 for RGB.
    """
    pixels = _pixels(picture)
    area = pixels.shape[0] * pixels.shape[1]
    if channels == 1:
        pixels = gray(pixels)
    sums = _sums(_sums(pixels, height).swapaxes(0, 1), width).swapaxes(0, 1)
    small: Array = ((sums + area // 2) // area).astype(np.uint8)
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


def gray(pixels: Array) -> Array:
    """Return a picture uint8 [height, width, 3] without colors, uint8 [height, width, 1]."""
    red, green, blue = (pixels[..., color].astype(np.uint16) * np.uint16(part) for color, part in enumerate(LUMINANCE))
    shades: Array = ((red + green + blue) >> 8).astype(np.uint8)[..., None]
    return shades


def _sums(values: Array, few: int) -> Array:
    """Return the sums of what each of `few` equal parts of the first axis covers, in 1 / few: int64 [few, …]."""
    edges = np.arange(few + 1) * len(values)
    whole, part = edges // few, (edges % few).reshape(-1, *[1] * (values.ndim - 1))
    sums: Array = few * np.add.reduceat(values, whole[:-1], axis=0, dtype=np.int64)
    sums[whole[:-1] == whole[1:]] = 0  # where an old value covers a new one, and `reduceat` returns it
    cut = part * values[np.minimum(whole, len(values) - 1)].astype(np.int64)
    sums += cut[1:] - cut[:-1]
    return sums
