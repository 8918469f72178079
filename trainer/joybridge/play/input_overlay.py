"""What agents press, drawn below a picture: pairs of axes as sticks, branches as keys. Drawn with Pillow."""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from joybridge.contract.codec import ActArrays
from joybridge.contract.tensors import Array
from joybridge.v1 import bridge_pb2 as pb

MARGIN, PAD, KEY, DOT, LETTERS = 8, 44, 22, 4, 12  # px: space, side of a stick, height of a key, radius; size of text
BACKGROUND, KEYS, INK, ACCENT = "#16181f", "#2b2f3b", "#e8e8ee", "#e0703c"


class _Place(NamedTuple):
    """A stick or a key: where it is drawn, whose it is, and what it shows."""

    left: int
    top: int
    width: int
    behavior: int
    agent: int
    axes: Sequence[int]  # one or two; none: a key
    branch: int


class Inputs:
    """Draws what the agents of the first arena do. All agents of all behaviors are shown, in the order of the spec."""

    def __init__(self, spec: pb.GameSpec) -> None:
        """Lay out sticks and keys in rows as wide as the picture of the game."""
        self._spec, self._font = spec, ImageFont.load_default(size=LETTERS)
        self._places: list[_Place] = []
        left = top = MARGIN
        for place in self._all():
            if left > MARGIN and left + place.width + MARGIN > spec.picture.width:
                left, top = MARGIN, top + PAD + MARGIN
            self._places.append(place._replace(left=left, top=top))
            left += place.width + MARGIN
        self.height = top + PAD + MARGIN  # px, that are added to a picture

    def below(self, picture: Array, acts: Sequence[ActArrays]) -> Array:
        """Return a picture with the inputs below it, uint8 [height + self.height, width, 3].

        picture: uint8 [height, width, 3]. acts: one per behavior, the first arena's lanes first.
        """
        strip = Image.new("RGB", (picture.shape[1], self.height), BACKGROUND)
        draw = ImageDraw.Draw(strip)
        for place in self._places:
            device, act = self._spec.behaviors[place.behavior].device, acts[place.behavior]
            if place.axes:
                axes = [device.axes[axis] for axis in place.axes]
                values = act.axes[place.agent, place.axes].tolist()
                self._draw_stick(draw, place, axes, values)
            else:
                self._draw_key(draw, place, device.branches[place.branch], int(act.choices[place.agent, place.branch]))
        return np.concatenate([picture, np.asarray(strip)])

    def _all(self) -> Iterator[_Place]:
        """Yield all sticks and keys, not yet placed."""
        for index, behavior in enumerate(self._spec.behaviors):
            device = behavior.device
            for agent in range(behavior.agents_per_arena):
                for first in range(0, len(device.axes), 2):
                    axes = list(range(first, min(first + 2, len(device.axes))))
                    name = max(self._width(device.axes[axis].name) for axis in axes)
                    yield _Place(0, 0, PAD + MARGIN + name, index, agent, axes, 0)
                for number, branch in enumerate(device.branches):
                    longest = max((_label(branch, choice) for choice in range(len(branch.choices))), key=len)
                    yield _Place(0, 0, self._width(longest) + 2 * MARGIN, index, agent, (), number)

    def _draw_stick(
        self, draw: ImageDraw.ImageDraw, place: _Place, axes: Sequence[pb.Axis], values: Sequence[float]
    ) -> None:
        """Draw a pad with a dot: the first axis goes to the right, the second one up."""
        left, top = place.left, place.top if len(axes) == 2 else place.top + (PAD - KEY) // 2
        height = PAD if len(axes) == 2 else KEY
        draw.rounded_rectangle([left, top, left + PAD, top + height], 6, KEYS)
        shares = [(value - axis.low) / (axis.high - axis.low) for axis, value in zip(axes, values, strict=True)]
        x = left + DOT + shares[0] * (PAD - 2 * DOT)
        y = top + height - DOT - (shares[1] if len(axes) == 2 else 0.5) * (height - 2 * DOT)
        draw.ellipse([x - DOT, y - DOT, x + DOT, y + DOT], ACCENT)
        for row, axis in enumerate(axes):
            line = place.top + (row + 0.5) * PAD / len(axes)
            draw.text((left + PAD + MARGIN, line), axis.name, INK, self._font, anchor="lm")

    def _draw_key(self, draw: ImageDraw.ImageDraw, place: _Place, branch: pb.Branch, choice: int) -> None:
        """Draw a key, colored while it is a button that is pressed."""
        top, color = place.top + (PAD - KEY) // 2, ACCENT if choice and len(branch.choices) == 2 else KEYS
        draw.rounded_rectangle([place.left, top, place.left + place.width, top + KEY], 6, color)
        middle = (place.left + place.width / 2, top + KEY / 2)
        draw.text(middle, _label(branch, choice), INK, self._font, anchor="mm")

    def _width(self, text: str) -> int:
        return round(self._font.getlength(text))


def _label(branch: pb.Branch, choice: int) -> str:
    """Return what a key shows: its name, and of more than two choices the present one."""
    return branch.name if len(branch.choices) == 2 else f"{branch.name}: {branch.choices[choice]}"
