"""Our own scaler for pictures: integers only, so that every processor gives the same bytes.

A picture is sampled to a whole multiple of the wanted size, nearest pixels first, and blocks of samples are averaged.
Two colors are summed in one 32-bit number: a block has at most 16 samples, so a sum of bytes needs 12 bits.
"""

from functools import lru_cache
from typing import Any
from zlib import crc32

import numpy as np
import numpy.typing as npt

from joybridge.adapters.pygame_programs.inside.display import Pixels
from joybridge.contract.tensors import Array

MAX_SAMPLES = 4  # along each side of a block


def scale(pixels: Pixels, height: int, width: int) -> Array:
    """Return 0x00RRGGBB pixels as a picture of a size, uint8 [height, width, 3]."""
    rows, samples_y = _samples(pixels.shape[0], height)
    columns, samples_x = _samples(pixels.shape[1], width)
    samples = pixels.take(rows, axis=0).take(columns, axis=1)  # twice as fast as both at once
    blocks = samples.reshape(samples_y, height, samples_x, width)
    red_blue, green = _sums(blocks & np.uint32(0xFF00FF)), _sums(blocks & np.uint32(0xFF00))
    count = np.uint32(samples_y * samples_x)
    picture = np.empty((height, width, 3), np.uint8)
    picture[..., 0] = (red_blue >> np.uint32(16)) // count
    picture[..., 1] = (green >> np.uint32(8)) // count
    picture[..., 2] = (red_blue & np.uint32(0xFFFF)) // count
    return picture


def crop(pixels: Pixels, center: tuple[int, int], side: int) -> Array:
    """Return the pixels around a place (x, y), uint8 [side, side, 3]; black outside of the picture."""
    left, top = center[0] - side // 2, center[1] - side // 2
    part = np.zeros((side, side), np.uint32)
    x, y = max(left, 0), max(top, 0)
    inside = pixels[y : max(top + side, 0), x : max(left + side, 0)]
    part[y - top : y - top + inside.shape[0], x - left : x - left + inside.shape[1]] = inside
    return scale(part, side, side)


def hash_of(pixels: Pixels) -> bytes:
    """Return eight bytes that differ where pictures do, but for one pair in 2**32: a checksum costs the least."""
    colors: Any = pixels & np.uint32(0xFFFFFF)  # the fourth byte is not shown
    return crc32(colors, crc32(b"%dx%d" % pixels.shape)).to_bytes(8, "little")


@lru_cache
def _samples(pixels: int, wanted: int) -> tuple[npt.NDArray[np.intp], int]:
    """Return the indices of the samples along a side, and how many there are for each wanted pixel.

    The first samples of all wanted pixels come first, then their second ones: rows that lie together are summed faster.
    """
    each = min(max(pixels // wanted, 1), MAX_SAMPLES)
    indices = (2 * np.arange(wanted * each) + 1) * pixels // (2 * wanted * each)
    return indices.reshape(wanted, each).T.ravel(), each


def _sums(blocks: Pixels) -> Pixels:
    """Return the sums of samples [samples_y, height, samples_x, width], by pixel."""
    rows: Pixels = sum(blocks[1:], start=blocks[0])
    return sum((rows[:, column] for column in range(1, rows.shape[1])), start=rows[:, 0])
