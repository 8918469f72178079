"""The pictures that demonstrated decisions see: each is stored once, however many stacks it is in. Needs no torch.

The pictures of all stretches are numbered, step by step and lane by lane, so that stacks are made of numbers first.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from joybridge.contract.tensors import Array
from joybridge.demonstrations.recorded import RecordedEpisodes
from joybridge.policy.encoder import ObservationEncoder
from joybridge.ppo.history import BLANK, Window


class Numbered(NamedTuple):
    """A stretch, and the number of the first picture of one of its behaviors."""

    stretch: RecordedEpisodes
    first: int
    lanes: int

    def numbers(self, step: int) -> Array:
        """Return the numbers of the pictures of a step, [lanes, 1]."""
        begin = self.first + step * self.lanes
        return np.arange(begin, begin + self.lanes)[:, None]


def number_pictures(stretches: Sequence[RecordedEpisodes], behavior: int) -> list[Numbered]:
    """Return the stretches with the numbers of the pictures of a behavior; BLANK is no picture of them."""
    numbered, first = [], BLANK + 1
    for stretch in stretches:
        lanes = len(stretch.steps[0][behavior].terminated)
        numbered.append(Numbered(stretch, first, lanes))
        first += lanes * len(stretch.steps)
    return numbered


def gather_pictures(
    encoder: ObservationEncoder, numbered: Sequence[Numbered], behavior: int, sources: Array
) -> tuple[Window, ...]:
    """Return the stacks of each image. sources: numbers of their pictures, [n, frame_stack], oldest first."""
    used, rows = np.unique(np.append(sources.ravel(), BLANK), return_inverse=True)
    stored = [np.zeros((len(used), 1, *image.shape), np.uint8) for image in encoder.images.values()]
    for stretch, first, lanes in numbered if stored else ():
        for number, step in enumerate(stretch.steps):
            begin = first + number * lanes
            low, high = np.searchsorted(used, (begin, begin + lanes))
            for pictures, shown in zip(stored, encoder.pictures(step[behavior].observations), strict=True):
                pictures[low:high, 0] = shown[used[low:high] - begin]
    places = rows[:-1].reshape(sources.shape)
    return tuple(Window(pictures, places, np.zeros(len(sources), np.int64)) for pictures in stored)
