"""Crosses on a picture where agents put their pointers, as a picture of a game often shows no cursor. Needs no torch.

Only axes that say in the spec that they are positions are shown, because only of those it is known where they point.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from joybridge.contract.codec import ActArrays
from joybridge.contract.tensors import Array
from joybridge.layouts.device_names import pair_axes
from joybridge.v1 import bridge_pb2 as pb

SHARE = 40  # the picture's width in lengths of an arm, so that a cross is seen in a small copy, too
BRIGHT, DARK = (255, 220, 60), (20, 20, 20)  # of the cross and of its border, which is seen on any ground


def mark_pointers(picture: Array, spec: pb.GameSpec, acts: Sequence[ActArrays]) -> Array:
    """Return a picture of the first arena with a cross for every pointer, uint8 [height, width, 3].

    A cross has no middle, so that what is pointed at is seen.

    acts: one per behavior, the first arena's lanes first.
    """
    marked = picture
    for x, y in pointers(spec, acts):
        if marked is picture:
            marked = picture.copy()
        column, row = round(x * (picture.shape[1] - 1)), round(y * (picture.shape[0] - 1))
        arm = max(3, picture.shape[1] // SHARE)
        for thick, long, color in ((arm // 3 + 1, arm + 1, DARK), (arm // 6, arm, BRIGHT)):
            for height, width in ((thick, long), (long, thick)):
                top, left = max(0, row - height), max(0, column - width)
                marked[top : row + height + 1, left : column + width + 1] = color
        gap = arm // 2
        middle = np.s_[max(0, row - gap) : row + gap + 1, max(0, column - gap) : column + gap + 1]
        marked[middle] = picture[middle]
    return marked


def pointers(spec: pb.GameSpec, acts: Sequence[ActArrays]) -> Iterator[tuple[float, float]]:
    """Yield the place of every pointer: the shares of the picture's width, from the left, and height, from the top."""
    for behavior, act in zip(spec.behaviors, acts, strict=True):
        axes = behavior.device.axes
        for pair in pair_axes(axes):
            x, y = pair.axes
            if x is None or y is None or {axes[x].kind, axes[y].kind} != {pb.AXIS_KIND_POSITION}:
                continue
            for values in act.axes[: behavior.agents_per_arena]:
                across, up = (
                    float(np.clip((values[axis] - axes[axis].low) / (axes[axis].high - axes[axis].low), 0.0, 1.0))
                    for axis in (x, y)
                )
                yield 1.0 - across if pair.invert[0] else across, up if pair.invert[1] else 1.0 - up
