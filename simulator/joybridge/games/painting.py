"""Brushes for pictures in frames of reference, and the colors, that the two games with a beast share."""

from functools import lru_cache

import numpy as np
import numpy.typing as npt
import pygame

from joybridge.simulator.render import Color, Frame

WOOD, WOOD_SHADE, LEAVES, LEAVES_LIGHT = (15, 30, 28), (6, 14, 14), (24, 48, 40), (44, 78, 56)
BANK, BANK_DARK, NIGHT = (48, 88, 48), (10, 22, 18), (4, 10, 12)
GRASS_DARK, GRASS_LIGHT, BLADE, BLADE_LIGHT = (74, 128, 62), (84, 141, 69), (58, 106, 52), (118, 172, 86)
INK, WHITE, CHALK, AMBER = (18, 20, 26), (248, 248, 242), (214, 230, 196), (250, 190, 70)
BLINK, BLOOD = (92, 225, 240), (232, 60, 50)
PANEL, PANEL_EDGE, GROOVE = (13, 20, 26), (40, 58, 60), (34, 44, 52)
FAINT, DIM, PALE = (62, 76, 82), (120, 136, 138), (198, 210, 208)

BAR = 28.0  # length of a panel's bars, in hundredths of the picture's height


def mix(a: Color, b: Color, share: float) -> Color:
    """Return a color between a (share 0) and b (share 1)."""
    red, green, blue = (round(p + (q - p) * share) for p, q in zip(a, b, strict=True))
    return red, green, blue


def disc(canvas: pygame.Surface, frame: Frame, fill: Color, radius: float, x: float = 0.0, y: float = 0.0) -> None:
    """Fill a disc around the point (x, y) of a frame."""
    pygame.draw.circle(canvas, fill, frame.points([(x, y)])[0].tolist(), frame.length(radius))


def ring(canvas: pygame.Surface, frame: Frame, color: Color, radius: float, width: float) -> None:
    """Draw a circle around the origin of a frame."""
    pygame.draw.circle(canvas, color, frame.origin.tolist(), frame.length(radius), max(round(frame.length(width)), 2))


def arc(canvas: pygame.Surface, frame: Frame, color: Color, radius: float, start: float, turn: float) -> None:
    """Draw part of a circle from angle `start` on, `turn` counter-clockwise, both in rad."""
    angles = start + turn * np.linspace(0.0, 1.0, 40)
    line(canvas, frame, color, radius * np.stack([np.cos(angles), np.sin(angles)], axis=1), 0.08)


def line(canvas: pygame.Surface, frame: Frame, color: Color, points: npt.ArrayLike, width: float) -> None:
    """Draw a line through points [n, 2] of a frame."""
    pixels = frame.points(points).tolist()
    pygame.draw.lines(canvas, color, False, pixels, max(round(frame.length(width)), 2))


def haze(
    canvas: pygame.Surface, frame: Frame, color: Color, radius: float, inner: int, outer: int, clear: float = 0.0
) -> None:
    """Paint a soft disc: opacity (0..255) `inner` up to `clear` times the radius, then changing to `outer`."""
    soft = _soft_disc(round(frame.length(radius)), color, inner, outer, clear)
    canvas.blit(soft, (frame.origin - soft.get_width() / 2).round().tolist())


@lru_cache(maxsize=64)
def _soft_disc(radius: int, color: Color, inner: int, outer: int, clear: float) -> pygame.Surface:
    axis = np.arange(-radius, radius) + 0.5
    distance = np.hypot(axis[:, None], axis) / radius
    share = np.clip((distance - clear) / (1.0 - clear), 0.0, 1.0)
    pixels = np.empty((2 * radius, 2 * radius, 4), np.uint8)
    pixels[:, :, 2::-1] = color  # the order of the canvas, in which it is painted faster
    pixels[:, :, 3] = np.where(distance <= 1.0, inner + (outer - inner) * share * share * (3.0 - 2.0 * share), 0.0)
    return pygame.image.frombuffer(pixels.tobytes(), (2 * radius, 2 * radius), "BGRA")


def bar(canvas: pygame.Surface, left: float, top: float, unit: float, share: float, color: Color) -> None:
    """Paint a bar of BAR units that is filled up to a share (0..1).."""
    pygame.draw.rect(canvas, GROOVE, (left, top, BAR * unit, 1.8 * unit), border_radius=round(unit))
    if share > 0.0:
        filled = max(BAR * share, 1.8) * unit
        pygame.draw.rect(canvas, color, (left, top, filled, 1.8 * unit), border_radius=round(unit))
