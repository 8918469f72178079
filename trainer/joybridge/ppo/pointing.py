"""Heads that point: the logits of the cells of a map, from the convolutions themselves."""

from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor, nn

from joybridge.contract.tensors import Array
from joybridge.layouts import ActionSpace, Map
from joybridge.ppo.convolutions import Convolutions, ImageEncoder
from joybridge.ppo.images import shows


class Pointer(nn.Module):
    """The logits of one map. The body of the network says what to look for; what is found, and where, is the image's.

    `wanted` is a weight for each channel of each stage of the convolutions of each image that shows the map: outputs
    of the network, and a bias. A stage is weighted, resized to the cells by linear interpolation, and all are added
    up, as in the networks of Long, Shelhamer and Darrell (2015): coarse stages know more, fine ones know where.
    """

    def __init__(self, form: Map, encoder: ImageEncoder) -> None:
        """Point into the images of an encoder that show a map."""
        super().__init__()
        self.form = form
        self.images = [index for index, image in enumerate(encoder.images) if shows(image, form)]
        self.parts: list[tuple[int, int, int]] = []  # an image, a stage, and its channels
        for image in self.images:
            body = encoder.bodies[image]
            for stage, (channels, _, _) in enumerate(body.maps):
                rows, columns = resize(form, body, stage)
                self.register_buffer(f"rows{len(self.parts)}", rows, persistent=False)
                self.register_buffer(f"columns{len(self.parts)}", columns, persistent=False)
                self.parts.append((image, stage, channels))
        self.bias = nn.Parameter(torch.zeros(sum(channels for _, _, channels in self.parts)))

    def forward(self, maps: Sequence[Sequence[Tensor]], wanted: Tensor) -> Tensor:
        """Return logits [n, cells]. maps: see `Encoded`. wanted [n, bias]: outputs of the network."""
        weights = torch.split(wanted + self.bias, [channels for _, _, channels in self.parts], dim=1)
        logits = wanted.new_zeros(len(wanted), self.form.height, self.form.width)
        for part, ((image, stage, _), weight) in enumerate(zip(self.parts, weights, strict=True)):
            found = torch.einsum("nchw,nc->nhw", maps[image][stage], weight)
            logits = logits + self.get_buffer(f"rows{part}") @ found @ self.get_buffer(f"columns{part}").t()
        return logits.flatten(1)


class Pointers(nn.Module):
    """The logits of all maps, put among the other outputs of a tower.

    `columns` is how many outputs the tower then has: the logits of the branches that are no maps, each padded to the
    widest of them, what is for continuous actions, what pointers look for, and last the value if it is `shared`.
    """

    order: Tensor  # [columns of a network]: where each is among the outputs of the tower and then of the pointers

    def __init__(self, space: ActionSpace, continuous: int, shared: bool, encoder: ImageEncoder) -> None:
        """Point with the maps of an action space into the images of an encoder.

        continuous: outputs for continuous actions. shared: whether the tower has the value.
        """
        super().__init__()
        pointers = [Pointer(form, encoder) for _, form in space.maps]
        self.pointers, self.shared = nn.ModuleList(pointers), int(shared)
        self.wanted = [len(pointer.bias) for pointer in pointers]
        maps = dict(space.maps)
        others = [branch for branch in range(len(space.branches)) if branch not in maps]
        width = max((space.branches[branch] for branch in others), default=0)
        logits = len(others) * width
        self.columns = logits + continuous + sum(self.wanted) + shared
        padded = len(space.branches) * space.widest
        order = torch.zeros(padded + continuous + shared, dtype=torch.long)  # padding may be anything
        for row, branch in enumerate(others):
            order[branch * space.widest :][:width] = torch.arange(row * width, (row + 1) * width)
        order[padded : padded + continuous] = torch.arange(logits, logits + continuous)
        begin = self.columns
        for branch in maps:
            cells = space.branches[branch]
            order[branch * space.widest :][:cells] = torch.arange(begin, begin + cells)
            begin += cells
        order[len(order) - shared :] = self.columns - 1
        self.register_buffer("order", order, persistent=False)

    @property
    def each(self) -> list[Pointer]:
        """Return the pointer of each map."""
        return [pointer for pointer in self.pointers if isinstance(pointer, Pointer)]

    def forward(self, outputs: Tensor, maps: Sequence[Sequence[Tensor]]) -> Tensor:
        """Return the outputs of a network, see `Network`, from those of its tower. maps: see `Encoded`."""
        end = self.columns - self.shared
        wanted = torch.split(outputs[:, end - sum(self.wanted) : end], self.wanted, dim=1)
        logits = [pointer(maps, each) for pointer, each in zip(self.pointers, wanted, strict=True)]
        return torch.cat([outputs, *logits], dim=1).index_select(1, self.order)


def resize(form: Map, body: Convolutions, stage: int) -> tuple[Tensor, Tensor]:
    """Return the matrices that resize the map of a stage to cells: [cells, rows] and [cells, columns]."""
    sides = zip((form.height, form.width), (body.image.height, body.image.width), body.places(stage), strict=True)
    rows, columns = (_interpolate(cells, pixels, places, form.relative) for cells, pixels, places in sides)
    return rows, columns


def _interpolate(cells: int, pixels: int, places: Array, relative: bool) -> Tensor:
    """Return the weights of places in an image, for cells that divide it or, if relative, reach from edge to edge."""
    shares = np.linspace(0, 1, cells) if relative else (np.arange(cells) + 0.5) / cells
    weights = [np.interp(shares * pixels, places, one) for one in np.eye(len(places))]
    return torch.from_numpy(np.stack(weights, axis=1)).float()
