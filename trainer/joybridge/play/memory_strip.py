"""What policies with memory remember, as rows of colored cells below the picture of their game. Needs no torch."""

from collections.abc import Sequence

import numpy as np

from joybridge.contract.tensors import Array

ROW, GAP = 14, 2  # px
DARK, ABOVE, BELOW = (np.array(color, float) for color in ((34, 37, 46), (255, 170, 60), (70, 160, 255)))


class MemoryStrip:
    """A row for each agent of the first arena and each policy with memory; a cell for each number of its state.

    A cell is dark at 0, orange at 1 and above, blue at -1 and below. height: px, 0 if no policy has a memory.
    """

    def __init__(self, width: int, agents: Sequence[int]) -> None:
        """Take the width of the picture, px, and for each policy with memory how many agents of an arena it plays."""
        self._width, self.height = width, sum(agents) * (ROW + GAP)

    def draw(self, remembered: Sequence[Array]) -> Array:
        """Return the strip, uint8 [height, width, 3]. remembered: of each policy, [agents, numbers]."""
        strip = np.tile(DARK // 2, (self.height, self._width, 1))
        rows = [numbers for states in remembered for numbers in states]
        for row, numbers in enumerate(rows):
            cells = np.arange(self._width) * len(numbers) // self._width  # the cell of each column of pixels
            values = np.clip(numbers[cells], -1.0, 1.0)[:, None]
            colors = DARK + np.abs(values) * (np.where(values > 0, ABOVE, BELOW) - DARK)
            if self._width >= 4 * len(numbers):
                colors[1:][cells[1:] != cells[:-1]] = DARK // 2  # a line between two cells
            strip[row * (ROW + GAP) + GAP : (row + 1) * (ROW + GAP)] = colors
        return strip.astype(np.uint8)
