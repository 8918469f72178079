"""What the policies at play see, enlarged, beside the picture of their game, and what they remember, below it.

Needs no torch.
"""

from collections.abc import Sequence

import numpy as np

from joybridge.contract.codec import StepArrays
from joybridge.contract.tensors import Array
from joybridge.play.memory_strip import MemoryStrip
from joybridge.policy.encoder import ObservationEncoder
from joybridge.ppo.images import Image
from joybridge.v1 import bridge_pb2 as pb

MARGIN, ROWS = 8, 3  # px between images; images in a column
BACKGROUND = np.array([0x16, 0x18, 0x1F], np.uint8)


class PolicyView:
    """The images that policies get of the first arena: of every agent of their behaviors, each once.

    width, height: of the picture of the game with images to its right and memories below, px; the picture's own if
    there are none.
    """

    def __init__(
        self, spec: pb.GameSpec, encoders: Sequence[tuple[int, ObservationEncoder]], memories: Sequence[int] = ()
    ) -> None:
        """Lay out the images in columns, as large as they fit. encoders: each with the number of its behavior.

        memories: for each policy with memory, how many agents of an arena it plays.
        """
        self.width, self.height = spec.picture.width, spec.picture.height
        seen: dict[tuple[int, int], Image] = {}  # two policies may share the images of a behavior
        for behavior, encoder in encoders:
            names = [sensor.name for sensor in spec.behaviors[behavior].sensors]
            seen |= {(behavior, names.index(name)): image for name, image in encoder.images.items()}
        self._images = [
            (behavior, sensor, agent, image)
            for (behavior, sensor), image in seen.items()
            for agent in range(spec.behaviors[behavior].agents_per_arena)
        ]
        if self._images:
            self._lay_out()
        self._strip = MemoryStrip(self.width, memories)
        self.height += self._strip.height

    def _lay_out(self) -> None:
        wide, high = (max(getattr(image, side) for *_, image in self._images) for side in ("width", "height"))
        rows = min(ROWS, len(self._images))
        columns = -(-len(self._images) // rows)
        self._scale = max(1, min((self.height // rows - MARGIN) // high, self.width // (2 * columns * wide)))
        self._cell = wide * self._scale + MARGIN, high * self._scale + MARGIN
        self.width += columns * self._cell[0]
        self.height = max(self.height, rows * self._cell[1] - MARGIN)

    def beside(self, picture: Array, steps: Sequence[StepArrays], remembered: Sequence[Array] = ()) -> Array:
        """Return the picture of the first arena with what policies see in `steps`, uint8 [self.height, self.width, 3].

        picture: uint8 [height, width, 3]. steps: one per behavior, the first arena's lanes first. remembered: of each
        policy with memory, [agents, numbers].
        """
        if not self._images and not self._strip.height:
            return picture
        whole = np.tile(BACKGROUND, (self.height, self.width, 1))
        whole[: picture.shape[0], : picture.shape[1]] = picture
        rows = min(ROWS, len(self._images))
        for number, (behavior, sensor, agent, image) in enumerate(self._images):
            left = picture.shape[1] + number // rows * self._cell[0] + MARGIN
            top = number % rows * self._cell[1]
            pixels = steps[behavior].observations[sensor][agent].reshape(image.shape)
            large = pixels.repeat(self._scale, axis=0).repeat(self._scale, axis=1)
            whole[top : top + large.shape[0], left : left + large.shape[1]] = large  # gray has one channel
        if self._strip.height:
            whole[-self._strip.height :] = self._strip.draw(remembered)
        return whole
