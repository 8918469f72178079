"""Encoders of images: from bytes to features, beside which all numbers pass by. Differentiated by autograd."""

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor, nn
from torch.nn import functional

from joybridge.contract.tensors import Array
from joybridge.ppo.activations import ACTIVATIONS
from joybridge.ppo.images import Image, encoder_kind
from joybridge.ppo.observation_tensors import Observations

FEATURES = 128  # of an image, with the encoder of windows, beside its moments
WHITE = 255.0  # the byte that becomes 1
WINDOWS_WHITE = 64.0  # the same with the encoder of windows, for pictures of which much is dark
# Pixels of a side that one place of the last map depends on, all in all.
FIELDS = {"windows": 16, "moments": 16, "nature": 36}
APART = 8  # pixels between two such places
GAIN = 4.0  # of changes from frame to frame, which are small beside the pictures themselves
FAINT = 0.1  # what has this mass is placed half way between where it is and the middle


class Encoded(NamedTuple):
    """What an encoder makes of observations."""

    features: Tensor  # [n, features]
    maps: list[list[Tensor]]  # of each image what each stage of its convolutions returns, [n, channels, height, width]


class ImageEncoder(nn.Module):
    """Turns observations into features: the numbers, then the features of each image.

    The pictures of a stack are channels of one image, oldest first. Every image sensor has convolutions of its own.
    Nothing is averaged over an image, because a pointer needs positions.
    """

    def __init__(
        self,
        kind: str,
        images: Sequence[Image],
        numbers: int,
        frame_stack: int,
        activation: str,
        differences: bool = False,
    ) -> None:
        """Encode stacks of so many pictures beside `numbers` numbers.

        kind, differences: see `image_encoder` and `frame_differences` of `PolicyConfig`.
        """
        super().__init__()
        self.images = images
        self.convolutions = nn.ModuleList(Convolutions(kind, image, frame_stack, activation) for image in images)
        if differences:
            for body in self.bodies:
                body.see_differences(frame_stack)
        self.features = numbers + sum(body.features for body in self.bodies)

    @property
    def bodies(self) -> list["Convolutions"]:
        """Return the convolutions of each image."""
        return [body for body in self.convolutions if isinstance(body, Convolutions)]

    def forward(self, observations: Observations) -> Encoded:
        """Return features and maps."""
        features, maps = [observations.numbers], []
        for stacks, body in zip(observations.images, self.bodies, strict=True):
            assert isinstance(stacks, Tensor)
            own, stages = body(stacks)
            features.append(own)
            maps.append(stages)
        return Encoded(torch.cat(features, dim=1), maps)


class Convolutions(nn.Module):
    """What one image passes through: the stages of convolutions, and a dense layer after windows."""

    def __init__(self, kind: str, image: Image, frame_stack: int, activation: str) -> None:
        """Make layers for stacks of so many pictures. kind: see `PolicyConfig.image_encoder`."""
        super().__init__()
        kind = encoder_kind(kind, image)
        windows = kind in ("windows", "moments")
        self.image, self.white = image, WINDOWS_WHITE if windows else WHITE
        channels = image.channels * frame_stack
        self.stages = nn.ModuleList(STAGES[kind](channels, activation, padding_of(kind, image)))
        with torch.no_grad():
            pixels = torch.zeros(1, image.height, image.width, channels)
            self.maps = [tuple(stage.shape[1:]) for stage in self.see(pixels)]  # channels, height, width of each stage
        self.features = math.prod(self.maps[-1])
        self.dense = nn.Sequential()
        if windows:
            self.dense = nn.Sequential(nn.Linear(self.features, FEATURES), Activate(activation))
            self.features = FEATURES
        found = self.maps if kind == "moments" else []
        self.moments = nn.ModuleList(Moments(height, width) for _, height, width in found)
        self.features += sum(Moments.NUMBERS * channels for channels, _, _ in found)

    def forward(self, stacks: Tensor) -> tuple[Tensor, list[Tensor]]:
        """Return features [n, features] and what each stage returns, for bytes [n, frames, height, width, channels].

        All stacks that are black count as one: of several games, those without this image have nothing else.
        """
        bright = stacks.flatten(1).amax(dim=1) > 0
        if len(stacks) - int(bright.sum()) < 2:  # a single black stack would only be moved
            return self._encode(stacks)
        features, maps = self._encode(torch.cat([torch.zeros_like(stacks[:1]), stacks[bright]]))
        places = bright.cumsum(0) * bright  # black ones have the first place
        return features[places], [values[places] for values in maps]

    def _encode(self, stacks: Tensor) -> tuple[Tensor, list[Tensor]]:
        n, frames, height, width, channels = stacks.shape
        # In the order of memory in which convolutions are fastest, channels last; several gray pictures, merely
        # reshaped, would not be in it. Divided in place, which costs half as much.
        bytes_ = stacks.permute(0, 2, 3, 1, 4).contiguous().view(n, height, width, frames * channels)
        pixels = bytes_.float().div_(self.white)
        maps = self.see(pixels)
        features = self.dense(maps[-1].flatten(1))
        if self.moments:
            moments = (moment(values) for moment, values in zip(self.moments, maps, strict=True))
            features = torch.cat([features, *moments], dim=1)
        return features, maps

    def see_differences(self, frame_stack: int) -> None:
        """Let the first convolution learn from what has changed between the pictures of a stack."""
        first = self.stages[0]
        assert isinstance(first, nn.Sequential) and isinstance(first[0], nn.Conv2d)
        first[0] = DifferenceConvolution(first[0], frame_stack)

    def see(self, pixels: Tensor) -> list[Tensor]:
        """Return what each stage returns for [n, height, width, channels]."""
        maps = [pixels.permute(0, 3, 1, 2)]
        for stage in self.stages:
            maps.append(stage(maps[-1]))
        return maps[1:]

    def places(self, stage: int) -> tuple[Array, Array]:
        """Return where the rows and the columns of the map of a stage are in the image, in pixels; 0 is its edge."""
        first, apart = 0.5, 1.0  # of the windows of the layers so far: the middle of the first, and their distance
        for module in (each for stage_so_far in self.stages[: stage + 1] for each in stage_so_far.modules()):
            if isinstance(module, nn.Conv2d | nn.MaxPool2d):
                size, stride, padding = (
                    value if isinstance(value, int) else int(value[0])
                    for value in (module.kernel_size, module.stride, module.padding)
                )
                first, apart = first + ((size - 1) / 2 - padding) * apart, apart * stride
        _, height, width = self.maps[stage]
        return first + apart * np.arange(height), first + apart * np.arange(width)


def padding_of(kind: str, image: Image) -> int:
    """Return how many black pixels surround an image, so that the windows of all convolutions reach all of it."""
    if kind not in FIELDS:
        return 0
    field, sides = FIELDS[kind], (image.height, image.width)
    return next(
        padding
        for padding in range(APART)
        if all((side + 2 * padding - field) // APART * APART + field - padding >= side for side in sides)
    )


class Activate(nn.Module):
    """An activation as a module."""

    def __init__(self, activation: str) -> None:
        """Take the name of an activation."""
        super().__init__()
        self.function: Callable[[Tensor], Tensor] = ACTIVATIONS[activation]

    def forward(self, values: Tensor) -> Tensor:
        """Return the activation of each value."""
        return self.function(values)


class DifferenceConvolution(nn.Module):
    """A convolution whose weights are those of the changes from frame to frame, and of the newest frame.

    A change is a difference of pixels times GAIN. Both are sums of pixels, so this is a convolution of the pictures as
    they are, with the weights `seen`. Only its gradient steps differ: what moves in front of a still background is
    learned in fewer of them.
    """

    basis: Tensor  # [frames, frames]: of which frames, oldest first, each change and then the newest frame are made

    def __init__(self, convolution: nn.Conv2d, frames: int) -> None:
        """Take the weights of a convolution of so many frames."""
        super().__init__()
        self.convolution, self.frames = convolution, frames
        basis = GAIN * (torch.diag(torch.ones(frames - 1), 1) - torch.eye(frames))
        basis[-1, -1] = 1.0
        self.register_buffer("basis", basis, persistent=False)

    @property
    def seen(self) -> Tensor:
        """Return the weights of the pictures as they are, [features, channels, height, width]."""
        weight = self.convolution.weight
        by_frame = weight.view(len(weight), self.frames, -1, *weight.shape[2:])
        return torch.einsum("cf,ockhw->ofkhw", self.basis, by_frame).reshape(weight.shape)

    def forward(self, pixels: Tensor) -> Tensor:
        """Return the features [n, features, height, width] of stacks [n, channels, height, width]."""
        layer = self.convolution
        return functional.conv2d(pixels, self.seen, layer.bias, layer.stride, layer.padding)


class Moments(nn.Module):
    """How much each channel of a map finds, and where in the image, as numbers.

    Squares of what it finds are masses. A dense layer would have to learn for every place anew what it means. These
    numbers are the same function of a position everywhere, and tell it to a part of a pixel.
    """

    NUMBERS = 3  # per channel
    grid: Tensor  # [3, height * width]: of each place of the map x and y, of -2 to 2 from edge to edge, and 1

    def __init__(self, height: int, width: int) -> None:
        """Take the size of the map."""
        super().__init__()
        y, x = ((4 * torch.arange(size) + 2) / size - 2 for size in (height, width))
        grid = torch.stack([x.repeat(height), y.repeat_interleave(width), torch.ones(height * width)])
        self.register_buffer("grid", grid, persistent=False)

    def forward(self, values: Tensor) -> Tensor:
        """Return [n, 3 * channels] for [n, channels, height, width]: all x, all y, and all masses, as shares of 1."""
        # In the order of memory of convolutions, channels last: gradients in another one would slow theirs down.
        masses = values.permute(0, 2, 3, 1).flatten(1, 2).square()
        x, y, mass = (self.grid @ masses).unbind(dim=1)
        return torch.cat([x / (mass + FAINT), y / (mass + FAINT), mass / (mass + 1.0)], dim=1)


class Residual(nn.Module):
    """What two convolutions add to their input."""

    def __init__(self, channels: int, activation: str) -> None:
        """Keep the number of channels and the size."""
        super().__init__()
        self.layers = nn.Sequential(
            Activate(activation),
            nn.Conv2d(channels, channels, 3, padding=1),
            Activate(activation),
            nn.Conv2d(channels, channels, 3, padding=1),
        )

    def forward(self, values: Tensor) -> Tensor:
        """Return the input and what is added to it."""
        return values + self.layers(values)  # type: ignore[no-any-return]


def _windows(channels: int, activation: str, padding: int) -> list[nn.Module]:
    """Return two convolutions over windows that overlap by half, which cost a processor little."""
    return [
        nn.Sequential(nn.Conv2d(channels, 16, 8, stride=4, padding=padding), Activate(activation)),
        nn.Sequential(nn.Conv2d(16, 32, 3, stride=2), Activate(activation)),
    ]


def _simple(channels: int, activation: str, _: int) -> list[nn.Module]:
    """Return two convolutions for images of any size; each halves it."""
    return [
        nn.Sequential(nn.Conv2d(channels, 16, 3, stride=2, padding=1), Activate(activation)),
        nn.Sequential(nn.Conv2d(16, 32, 3, stride=2, padding=1), Activate(activation)),
    ]


def _nature(channels: int, activation: str, padding: int) -> list[nn.Module]:
    """Return the convolutions of Mnih et al. (2015), for images of about 84 x 84."""
    return [
        nn.Sequential(nn.Conv2d(channels, 32, 8, stride=4, padding=padding), Activate(activation)),
        nn.Sequential(nn.Conv2d(32, 64, 4, stride=2), Activate(activation)),
        nn.Sequential(nn.Conv2d(64, 64, 3), Activate(activation)),
    ]


def _impala(channels: int, activation: str, _: int) -> list[nn.Module]:
    """Return the residual network of Espeholt et al. (2018); each of its three stages halves the size."""
    stages: list[nn.Module] = []
    for before, after in ((channels, 16), (16, 32), (32, 32)):
        halved = nn.Conv2d(before, after, 3, padding=1), nn.MaxPool2d(3, stride=2, padding=1)
        stages.append(nn.Sequential(*halved, Residual(after, activation), Residual(after, activation)))
    return [*stages[:-1], nn.Sequential(stages[-1], Activate(activation))]


STAGES: dict[str, Callable[[int, str, int], list[nn.Module]]] = {
    "windows": _windows,
    "moments": _windows,
    "simple": _simple,
    "nature": _nature,
    "impala": _impala,
}
