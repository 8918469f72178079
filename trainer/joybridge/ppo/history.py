"""The last pictures of some lanes: each is stored once, and a stack of them is gathered when it is used."""

from typing import NamedTuple

import numpy as np

from joybridge.contract.tensors import Array
from joybridge.ppo.images import Image

BLANK = 0  # the row of a picture that is black: before the first one of an episode


class Window(NamedTuple):
    """Stacks of pictures that are gathered when they are used; a minibatch takes some of its rows."""

    pictures: Array  # uint8 [rows of the history, lanes, height, width, channels]
    sources: Array  # [n, frame_stack]: the rows of the pictures of each stack, oldest first
    lanes: Array  # [n]

    def gather(self) -> Array:
        """Return the stacks, uint8 [n, frame_stack, height, width, channels]."""
        return self.pictures[self.sources, self.lanes[:, None]]

    def rows(self, index: Array) -> "Window":
        """Return some of the stacks."""
        return Window(self.pictures, self.sources[index], self.lanes[index])


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
