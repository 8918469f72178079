"""The last pictures of some lanes: each is stored once, and a stack of them is gathered when it is used."""

from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from joybridge.contract.tensors import Array
from joybridge.ppo.images import Image

BLANK = 0  # the row of a picture that is black: before the first one of an episode


class Window(NamedTuple):
    """Stacks of pictures that are gathered when they are used; a minibatch takes some of its rows."""

    pictures: Array  # uint8 [rows of the history, lanes, height, width, channels]
    sources: Array  # [n, frame_stack]: the rows of the pictures of each stack, oldest first
    lanes: Array  # [n]
    shifts: Array | None = None  # [n, 2]: pixels by which a stack is moved down and right; None: as they are

    def gather(self) -> Array:
        """Return the stacks, uint8 [n, frame_stack, height, width, channels]."""
        stacks = self.pictures[self.sources, self.lanes[:, None]]
        return stacks if self.shifts is None else shifted(stacks, self.shifts)

    def rows(self, index: Array) -> "Window":
        """Return some of the stacks."""
        shifts = None if self.shifts is None else self.shifts[index]
        return Window(self.pictures, self.sources[index], self.lanes[index], shifts)

    def shift(self, pixels: int, rng: np.random.Generator) -> "Window":
        """Return the same stacks, each moved at random, by up to so many pixels in each direction."""
        return self._replace(shifts=rng.integers(-pixels, pixels + 1, (len(self.lanes), 2)))


def shifted(stacks: Array, shifts: Array) -> Array:
    """Return stacks of pictures, [n, frame_stack, height, width, channels], each moved down and right.

    shifts: pixels, [n, 2]. What moves in is the border, again and again.
    """
    most = int(abs(shifts).max(initial=0))
    around = np.pad(stacks, ((0, 0), (0, 0), (most, most), (most, most), (0, 0)), mode="edge")
    places = sliding_window_view(around, stacks.shape[2:4], axis=(2, 3))  # [n, frame_stack, down, right, channels, …]
    down, right = (most - shifts).T
    return np.moveaxis(places[np.arange(len(stacks)), :, down, right], 2, -1)


class History:
    """Pictures of one sensor in a rollout of `steps` decisions: row t of `sources` is what decision t sees.

    Row 0 of `pictures` is blank, the next `frame_stack` rows hold what decision 0 sees, and each decision adds one.
    """

    def __init__(self, steps: int, lanes: int, image: Image, frame_stack: int) -> None:
        """Begin with blank pictures."""
        self.frame_stack = frame_stack
        self.pictures = np.zeros((1 + frame_stack + steps, lanes, *image.shape), np.uint8)
        self.sources = np.zeros((steps + 1, lanes, frame_stack), np.int32)
        self._lanes = np.arange(lanes)

    def begin(self, pictures: Array, lanes: slice) -> None:
        """Take the first pictures of new episodes, uint8 [lanes, height, width, channels]."""
        self.pictures[self.frame_stack, lanes] = pictures
        self.sources[0, lanes] = BLANK
        self.sources[0, lanes, -1] = self.frame_stack

    def push(self, t: int, lanes: slice, pictures: Array) -> tuple[Array, Array, Array]:
        """Store the pictures that follow decision t; return the sources before and after it, and the new one."""
        row = self.frame_stack + t + 1
        self.pictures[row, lanes] = pictures
        new = np.full((len(pictures), 1), row, np.int32)
        return self.sources[t, lanes], self.sources[t + 1, lanes], new

    def window(self, t: int, lanes: slice = slice(None)) -> Window:
        """Return what decision t sees in some lanes."""
        return Window(self.pictures, self.sources[t, lanes], self._lanes[lanes])

    def at(self, steps: Array, lanes: Array) -> Window:
        """Return what some decisions see, of these steps and lanes."""
        return Window(self.pictures, self.sources[steps, lanes], lanes)

    def recall(self, lanes: Array, stacks: Array) -> None:
        """Let decision 0 of some lanes be one that saw these stacks, uint8 [lanes, frame_stack, height, …]."""
        if len(self.pictures) == len(self.sources) + self.frame_stack:  # they need rows of their own, if any wait
            self.pictures = np.concatenate([self.pictures, np.zeros_like(self.pictures[-self.frame_stack :])])
        self.pictures[-self.frame_stack :, lanes] = np.moveaxis(stacks, 1, 0)
        self.sources[0, lanes] = np.arange(len(self.pictures) - self.frame_stack, len(self.pictures))

    def restart(self) -> None:
        """Let what the last row sees be what decision 0 of the next rollout sees."""
        self.load(self.window(-1).gather())

    def load(self, stacks: Array) -> None:
        """Put what decision 0 sees, uint8 [lanes, frame_stack, height, width, channels]."""
        self.pictures[1 : self.frame_stack + 1] = np.moveaxis(stacks, 1, 0)
        self.sources[0] = np.arange(1, self.frame_stack + 1)
