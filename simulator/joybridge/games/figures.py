"""The beast, the people whom it hunts, and their cursor, for the pictures of two games. All of them face +x."""

from typing import NamedTuple

import numpy as np
import pygame

from joybridge.games.painting import AMBER, BLOOD, INK, WHITE, disc, haze, line, mix, ring
from joybridge.simulator.render import Color, Frame, ellipse, shape

SKIN, HAIR, BOOT = (246, 206, 170), (250, 214, 96), (70, 46, 36)
FUR_CALM, FUR_ANGRY, THROAT, BONE = (70, 54, 92), (186, 24, 30), (44, 4, 8), (240, 230, 206)
EYE_CALM, EYE_ANGRY = (255, 206, 64), (255, 244, 200)

# Parts of the beast, whose muzzle ends 0.46 in front of the origin. Of parts in pairs, the left one.
_SPIKES = np.arange(30) * np.pi / 15
_SPIKE_LENGTHS = np.where(np.arange(30) % 2, 1.0, 0.72)
FUR = np.stack([-0.36 + 0.84 * _SPIKE_LENGTHS * np.cos(_SPIKES), 0.76 * _SPIKE_LENGTHS * np.sin(_SPIKES)], axis=1)
MANE = FUR * 0.64 + (-0.24, 0.0)
HEAD = (
    (0.46, 0.0),
    (0.42, 0.24),
    (0.16, 0.42),
    (-0.26, 0.42),
    (-0.42, 0.0),
    (-0.26, -0.42),
    (0.16, -0.42),
    (0.42, -0.24),
)
MAW = ((0.46, 0.0), (0.42, 0.25), (0.24, 0.31), (0.14, 0.0), (0.24, -0.31), (0.42, -0.25))
HORN = ((-0.06, 0.32), (0.06, 0.62), (0.34, 0.8), (0.68, 0.74), (0.4, 0.62), (0.26, 0.36))
EYE = ((-0.22, 0.07), (0.12, 0.14), (0.0, 0.36))
PAWS = ((0.3, 0.62), (0.3, -0.62), (-0.92, 0.6), (-0.92, -0.6))
CLAWS = (-0.1, 0.0, 0.1)


class Clothes(NamedTuple):
    """The colors of a person."""

    tunic: Color
    tunic_dark: Color
    hair: Color = HAIR


def person(canvas: pygame.Surface, frame: Frame, clothes: Clothes, stride: float) -> None:
    """Paint a person from above, about 0.32 wide to each side. stride: how far one foot is ahead."""
    for side in (1.0, -1.0):
        shape(canvas, frame, ellipse(0.1 + side * stride, side * 0.14, 0.16, 0.1), BOOT, INK)
        shape(canvas, frame, ellipse(0.08 - side * stride, side * 0.31, 0.12, 0.1), SKIN, INK)
    shape(canvas, frame, ellipse(-0.02, 0.0, 0.22, 0.32125), clothes.tunic, INK)
    shape(canvas, frame, ellipse(-0.12, 0.0, 0.1, 0.2), clothes.tunic_dark)
    shape(canvas, frame, ellipse(0.04, 0.0, 0.2, 0.2), SKIN, INK)
    shape(canvas, frame, ellipse(-0.02, 0.0, 0.17, 0.2), clothes.hair, INK)


def beast(canvas: pygame.Surface, frame: Frame, anger: float, time: float) -> None:
    """Paint the beast in a color that shows its anger (0..1). Its paws move with the time (s)."""
    anger = round(anger, 2)
    fur, step = mix(FUR_CALM, FUR_ANGRY, anger), 0.14 * np.sin((5.0 + 25.0 * anger) * time)
    haze(canvas, frame.placed(-0.36, 0.0), INK, 1.2, 190, 0, clear=0.4)
    haze(canvas, frame.placed(-0.3, 0.0), BLOOD, 1.7, round(120 * round(anger, 1)), 0, clear=0.3)
    for (x, y), stride in zip(PAWS, (step, -step, -step, step), strict=True):
        paw = frame.placed(x + stride, y)
        shape(canvas, paw, ellipse(0.0, 0.0, 0.2, 0.17), mix(fur, INK, 0.45), INK)
        for claw in CLAWS:
            shape(canvas, paw, ((0.12, claw - 0.04), (0.34, 1.3 * claw), (0.12, claw + 0.04)), BONE)
    shape(canvas, frame, FUR, fur, mix(fur, INK, 0.75))
    shape(canvas, frame, MANE, mix(fur, INK, 0.3))
    for side in (1.0, -1.0):
        shape(canvas, frame, np.multiply(HORN, (1.0, side)), BONE, INK)
    shape(canvas, frame, HEAD, mix(fur, INK, 0.12), INK)
    shape(canvas, frame, MAW, THROAT)
    for y in (-0.2, -0.1, 0.0, 0.1, 0.2):
        tip = 0.44 - abs(y) * 0.3
        shape(canvas, frame, ((tip, y - 0.05), (tip, y + 0.05), (tip - 0.16, y)), BONE)
    for side in (1.0, -1.0):
        haze(canvas, frame.placed(-0.04, 0.2 * side), AMBER, 0.34, 170, 0)
        shape(canvas, frame, np.multiply(EYE, (1.0, side)), mix(EYE_CALM, EYE_ANGRY, anger), INK)
        disc(canvas, frame, INK, 0.05, 0.02, 0.18 * side)


def cursor(canvas: pygame.Surface, frame: Frame, tint: Color = WHITE) -> None:
    """Paint the cursor in a color. A dark rim makes it visible on any background."""
    for color, rim in ((INK, 0.06), (tint, 0.0)):
        ring(canvas, frame, color, 0.32 + rim, 0.09 + 2 * rim)
        for x, y in ((1, 0), (-1, 0), (0, 1), (0, -1)):
            inner, outer = 0.2 - rim, 0.56 + rim
            line(canvas, frame, color, [(inner * x, inner * y), (outer * x, outer * y)], 0.09 + 2 * rim)
    disc(canvas, frame, AMBER, 0.08)
