"""Observations keep their form: numbers side by side, and images as bytes. Needs no torch."""

from typing import NamedTuple

from joybridge.contract.tensors import Array


class Observation(NamedTuple):
    """What some lanes observe and remember."""

    numbers: Array  # float32 [rows, frame_stack x numbers]
    images: tuple[Array, ...] = ()  # uint8 [rows, frame_stack, height, width, channels] each
    memory: Array | None = None  # float32 [rows, state_size]: what is remembered; None: policies without memory

    def rows(self, chosen: Array) -> "Observation":
        """Return copies of some rows, by their numbers."""
        memory = None if self.memory is None else self.memory[chosen]
        return Observation(self.numbers[chosen], tuple(image[chosen] for image in self.images), memory)
