"""Convolutions over the images of observations; all other numbers pass by. Differentiated by autograd."""

from collections.abc import Callable, Sequence

import torch
from torch import Tensor, nn

from joybridge.ppo.activations import ACTIVATIONS
from joybridge.ppo.images import Image


class ImageEncoder(nn.Module):
    """Turns flat observations into features: the other numbers of all frames, then the features of each image.

    The frames of a stack are channels of one image, oldest first. Every image sensor has convolutions of its own.
    """

    others: Tensor

    def __init__(self, kind: str, images: Sequence[Image], frame: int, frame_stack: int, activation: str) -> None:
        """Encode the images of frames of `frame` numbers. kind: simple, nature or impala."""
        super().__init__()
        self.images, self.frame_stack = images, frame_stack
        others = torch.ones(frame, dtype=torch.bool)
        for image in images:
            others[image.begin : image.end] = False
        self.register_buffer("others", others.nonzero().squeeze(1), persistent=False)
        build = {"simple": _simple, "nature": _nature, "impala": _impala}[kind]
        self.convolutions = nn.ModuleList(build(image.channels * frame_stack, activation) for image in images)
        with torch.no_grad():
            self.features = self(torch.zeros(1, frame * frame_stack)).shape[1]  # numbers per observation

    def forward(self, observations: Tensor) -> Tensor:
        """Return features [n, features] of observations [n, frame_stack x frame]."""
        rows = len(observations)
        frames = observations.view(rows, self.frame_stack, -1)
        parts = [frames[:, :, self.others].flatten(1)]
        for image, convolutions in zip(self.images, self.convolutions, strict=True):
            shape = (rows, self.frame_stack, image.height, image.width, image.channels)
            pixels = frames[:, :, image.begin : image.end].reshape(shape).permute(0, 1, 4, 2, 3)
            parts.append(convolutions(pixels.reshape(rows, -1, image.height, image.width)).flatten(1))
        return torch.cat(parts, dim=1)

    @property
    def layers(self) -> list[nn.Conv2d]:
        """Return all convolutions."""
        return [module for module in self.modules() if isinstance(module, nn.Conv2d)]


class Activate(nn.Module):
    """An activation as a module."""

    def __init__(self, activation: str) -> None:
        """Take the name of an activation."""
        super().__init__()
        self.function: Callable[[Tensor], Tensor] = ACTIVATIONS[activation]

    def forward(self, values: Tensor) -> Tensor:
        """Return the activation of each value."""
        return self.function(values)


class Residual(nn.Module):
    """What two convolutions add to their input."""

    def __init__(self, channels: int, activation: str) -> None:
        """Keep the number of channels and the size."""
        super().__init__()
        self.layers = nn.Sequential(
            Activate(activation), nn.Conv2d(channels, channels, 3, padding=1),
            Activate(activation), nn.Conv2d(channels, channels, 3, padding=1),
        )  # fmt: skip

    def forward(self, values: Tensor) -> Tensor:
        """Return the input and what is added to it."""
        return values + self.layers(values)  # type: ignore[no-any-return]


def _simple(channels: int, activation: str) -> nn.Module:
    """Return two convolutions for images of any size; each halves it."""
    return nn.Sequential(
        nn.Conv2d(channels, 16, 3, stride=2, padding=1), Activate(activation),
        nn.Conv2d(16, 32, 3, stride=2, padding=1), Activate(activation),
    )  # fmt: skip


def _nature(channels: int, activation: str) -> nn.Module:
    """Return the convolutions of Mnih et al. (2015), for images of about 84 x 84."""
    return nn.Sequential(
        nn.Conv2d(channels, 32, 8, stride=4), Activate(activation),
        nn.Conv2d(32, 64, 4, stride=2), Activate(activation),
        nn.Conv2d(64, 64, 3), Activate(activation),
    )  # fmt: skip


def _impala(channels: int, activation: str) -> nn.Module:
    """Return the residual network of Espeholt et al. (2018); each of its three parts halves the size."""
    parts: list[nn.Module] = []
    for before, after in ((channels, 16), (16, 32), (32, 32)):
        parts += [nn.Conv2d(before, after, 3, padding=1), nn.MaxPool2d(3, stride=2, padding=1)]
        parts += [Residual(after, activation), Residual(after, activation)]
    return nn.Sequential(*parts, Activate(activation))
