"""Encoders of images: from bytes to features, beside which all numbers pass by. Differentiated by autograd."""

from collections.abc import Callable, Sequence

import torch
from torch import Tensor, nn

from joybridge.ppo.activations import ACTIVATIONS
from joybridge.ppo.images import Image, encoder_kind
from joybridge.ppo.observation_tensors import Observations

FEATURES = 128  # of an image, with the encoder of windows
WHITE = 255.0  # the byte that becomes 1
WINDOWS_WHITE = 64.0  # the same with the encoder of windows, for pictures of which much is dark
STEP = 8  # pixels between two windows of the last convolution, of the encoders whose windows need whole steps
WHOLE = {"windows": 0, "nature": 4}  # the pixels of a side, modulo STEP, with which the windows reach all of it


class ImageEncoder(nn.Module):
    """Turns observations into features: the numbers, then the features of each image.

    The pictures of a stack are channels of one image, oldest first. Every image sensor has convolutions of its own.
    Nothing is averaged over an image, because a pointer needs positions.
    """

    def __init__(self, kind: str, images: Sequence[Image], numbers: int, frame_stack: int, activation: str) -> None:
        """Encode stacks of so many pictures beside `numbers` numbers. kind: see `PolicyConfig.image_encoder`."""
        super().__init__()
        builders = {"windows": _windows, "simple": _simple, "nature": _nature, "impala": _impala}
        self.convolutions = nn.ModuleList()
        self.white = [WINDOWS_WHITE if encoder_kind(kind, image) == "windows" else WHITE for image in images]
        self.features = numbers
        for image in images:
            channels = image.channels * frame_stack
            body = builders[encoder_kind(kind, image)](channels, activation)
            margin = margins(encoder_kind(kind, image), image)
            if any(margin):
                body = nn.Sequential(nn.ZeroPad2d(margin), body)
            with torch.no_grad():
                size = body(torch.zeros(1, channels, image.height, image.width)).numel()
            if encoder_kind(kind, image) == "windows":
                body = nn.Sequential(body, nn.Flatten(), nn.Linear(size, FEATURES), Activate(activation))
                size = FEATURES
            self.convolutions.append(body)
            self.features += size

    def forward(self, observations: Observations) -> Tensor:
        """Return features [n, features]."""
        parts = [observations.numbers]
        for stacks, convolutions, white in zip(observations.images, self.convolutions, self.white, strict=True):
            assert isinstance(stacks, Tensor)
            n, frames, height, width, channels = stacks.shape
            # Bytes become numbers in the order of memory in which convolutions are fastest: channels last.
            pixels = stacks.permute(0, 2, 3, 1, 4).reshape(n, height, width, frames * channels).float() / white
            parts.append(convolutions(pixels.permute(0, 3, 1, 2)).flatten(1))
        return torch.cat(parts, dim=1)


def margins(kind: str, image: Image) -> tuple[int, int, int, int]:
    """Return how many black pixels an image gets on the left, right, top and bottom, so that windows reach all of it.

    Without them, what stands in the last rows and columns would not be seen.
    """
    if kind not in WHOLE:
        return 0, 0, 0, 0
    wide, high = ((WHOLE[kind] - side) % STEP for side in (image.width, image.height))
    return wide // 2, wide - wide // 2, high // 2, high - high // 2


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


def _windows(channels: int, activation: str) -> nn.Module:
    """Return two convolutions over windows that overlap by half, which cost a processor little."""
    return nn.Sequential(
        nn.Conv2d(channels, 16, 8, stride=4), Activate(activation),
        nn.Conv2d(16, 32, 3, stride=2), Activate(activation),
    )  # fmt: skip


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
