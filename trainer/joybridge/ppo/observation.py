"""Observations keep their form: numbers side by side, and images as bytes. Needs no torch."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from joybridge.contract.tensors import Array


class Observation(NamedTuple):
    """What some lanes observe."""

    numbers: Array  # float32 [rows, frame_stack x numbers]
    images: tuple[Array, ...] = ()  # uint8 [rows, frame_stack, height, width, channels] each

    def rows(self, chosen: Array) -> "Observation":
        """Return copies of some rows. chosen: their numbers, or a bool for each row."""
        return Observation(self.numbers[chosen], tuple(image[chosen] for image in self.images))


def join(parts: Sequence[Observation]) -> Observation:
    """Return the rows of all parts, one after the other."""
    images = zip(*(part.images for part in parts), strict=True)
    return Observation(np.concatenate([part.numbers for part in parts]), tuple(map(np.concatenate, images)))
