"""Visual observations that come as PNG: one or more files side by side, whose channels are stacked.

A channel mapping says to which channel of the observation each decoded channel goes; several that go to the same one
are averaged, and -1 leaves one out. Without a mapping, an observation of one channel is the mean of the first picture,
and others are the first channels of all pictures.
"""

from collections.abc import Sequence
from io import BytesIO

import numpy as np
from PIL import Image

from joybridge.contract.tensors import Array

SIGNATURE = b"\x89PNG\r\n\x1a\n"
MAX_FILES = 64
MODES = {"L": 1, "RGB": 3, "RGBA": 4}


def decode(data: bytes, shape: tuple[int, int, int], mapping: Sequence[int]) -> Array:
    """Return an image, uint8 [height, width, channels]. Raises ValueError for what is no such image.

    shape: (channels, height, width), as it is sent.
    """
    channels, height, width = shape
    files = data.split(SIGNATURE)[1:]
    if not 1 <= len(files) <= MAX_FILES:
        raise ValueError(f"has {len(files)} PNG files, expected 1 to {MAX_FILES}")
    pictures = [_open(SIGNATURE + file, height, width) for file in files]
    if not mapping:
        if channels == 1:
            return _mean([pictures[0]])[:, :, None]
        stacked = np.concatenate(pictures, axis=2)[:, :, :channels]
    else:
        every = np.concatenate(pictures, axis=2)
        if len(mapping) != every.shape[2] or set(mapping) - {-1} != set(range(channels)):
            raise ValueError(
                f"maps channels to {list(mapping)[:16]}, expected one of -1..{channels - 1} for each of the "
                f"{every.shape[2]} decoded channels, and each at least once"
            )
        parts = [
            [every[:, :, k : k + 1] for k, to in enumerate(mapping) if to == channel] for channel in range(channels)
        ]
        stacked = np.stack([_mean(part) for part in parts], axis=2)
    if stacked.shape[2] != channels:
        raise ValueError(f"has {stacked.shape[2]} channels, expected {channels}")
    return stacked


def _open(data: bytes, height: int, width: int) -> Array:
    try:
        with Image.open(BytesIO(data), formats=["PNG"]) as picture:
            if picture.size == (width, height):
                array: Array = np.asarray(picture if picture.mode in MODES else picture.convert("RGB"))
                return array.reshape(height, width, -1)
            came = picture.size
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:
        raise ValueError(f"has a PNG file that cannot be read: {error}") from error
    raise ValueError(f"has a PNG file of {came[0]} x {came[1]} pixels, expected {width} x {height}")


def _mean(parts: Sequence[Array]) -> Array:
    """Return the mean over all channels of some arrays [height, width, channels]."""
    every: Array = np.concatenate(parts, axis=2)
    if every.shape[2] == 1:
        return every[:, :, 0]
    return np.rint(every.mean(axis=2)).astype(np.uint8)  # type: ignore[no-any-return]
