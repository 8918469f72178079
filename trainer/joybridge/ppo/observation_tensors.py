"""Observations as networks take them: tensors, and windows of pictures that are gathered for each minibatch."""

from dataclasses import dataclass, replace
from typing import Self

import torch
from torch import Tensor

from joybridge.ppo.history import Window
from joybridge.ppo.memory import Recall
from joybridge.ppo.observation import Observation


@dataclass(frozen=True)
class Observations:
    """What is learned from; every part has one row per timestep. A window is gathered for each minibatch."""

    numbers: Tensor  # [n, frame_stack x numbers]
    images: tuple[Tensor | Window, ...] = ()
    recall: Recall | None = None  # None: policies without memory, and before sequences are chosen

    def in_sequences(self, states: Tensor, lengths: Tensor) -> Self:
        """Return the same rows as sequences with these lengths, and what is remembered before each."""
        return replace(self, recall=Recall(states, lengths))

    def index_select(self, dimension: int, index: Tensor) -> Self:
        """Return the timesteps at `index`, with all images gathered. dimension: 0."""
        return type(self)(
            self.numbers.index_select(dimension, index),
            tuple(
                torch.from_numpy(image.rows(index.cpu().numpy()).gather()).to(self.numbers.device)
                if isinstance(image, Window)
                else image.index_select(dimension, index)
                for image in self.images
            ),
        )

    def to(self, device: torch.device) -> Self:
        """Return the same on a device; windows stay where they are until they are gathered."""
        images = tuple(image if isinstance(image, Window) else image.to(device) for image in self.images)
        return type(self)(self.numbers.to(device), images)

    def __len__(self) -> int:
        return len(self.numbers)


def to_tensors(observation: Observation, device: torch.device) -> Observations:
    """Return what is observed as tensors on a device, without copying where that is the processor."""
    images = tuple(torch.from_numpy(image).to(device) for image in observation.images)
    seen = Observations(torch.from_numpy(observation.numbers).to(device), images)
    if observation.memory is None:
        return seen
    states = torch.from_numpy(observation.memory).to(device)
    return seen.in_sequences(states, torch.ones(len(states), dtype=torch.int64, device=device))
