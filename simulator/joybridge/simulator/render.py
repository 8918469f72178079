"""Helpers for drawing pictures with pygame: frames of reference, shapes, gradients, text and smooth edges.

Draw on a canvas FINE times as large as the picture, then return `picture(canvas)`. Import this module inside `draw`
only: stepping a game must not load pygame.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt
import pygame

from joybridge.contract.tensors import Array

__all__ = ["FINE", "Box", "Color", "Frame", "block", "disc", "ellipse", "fade", "fit", "picture", "shape", "write"]

FINE = 2  # canvas pixels per picture pixel, in each direction; scaling down smooths the edges

Color = tuple[int, int, int] | tuple[int, int, int, int]
Box = tuple[float, float, float, float]  # left, bottom, right, top


@dataclass(frozen=True, eq=False)
class Frame:
    """A coordinate system on a canvas: its point p is at pixel `origin + axes @ p`."""

    origin: Array  # float64 [2], px
    axes: Array  # float64 [2, 2], px per unit; the columns are the x and the y direction

    def placed(self, x: float, y: float, scale_x: float = 1.0, scale_y: float = 1.0, turn: float = 0.0) -> "Frame":
        """Return a frame with its origin at (x, y) of this one, scaled, then turned counter-clockwise (rad)."""
        cosine, sine = np.cos(turn), np.sin(turn)
        own = np.array([[cosine * scale_x, -sine * scale_y], [sine * scale_x, cosine * scale_y]])
        return Frame(self.origin + self.axes @ (x, y), self.axes @ own)

    def points(self, points: npt.ArrayLike) -> Array:
        """Return the pixels, float64 [n, 2], of points [n, 2]."""
        pixels: Array = self.origin + np.asarray(points) @ self.axes.T
        return pixels

    def box(self, left: float, bottom: float, right: float, top: float) -> pygame.Rect:
        """Return a box in pixels. The frame must not be turned."""
        corners = np.rint(self.points([(left, bottom), (right, top)])).astype(int)
        low, high = corners.min(axis=0), corners.max(axis=0)
        return pygame.Rect(*map(int, low), *map(int, high - low))

    def length(self, units: float) -> float:
        """Return a length in px, scaled as the longer axis: use it for discs, which stay round in any frame."""
        return units * float(np.hypot(*self.axes).max())


def fit(width: int, height: int, half_width: float, half_height: float) -> Frame:
    """Return a frame for a canvas (px): y up, (0, 0) in the middle, and at least the given half extents visible."""
    scale = min(width / (2 * half_width), height / (2 * half_height))
    return Frame(np.array([width / 2, height / 2]), np.array([[scale, 0.0], [0.0, -scale]]))


def shape(canvas: pygame.Surface, frame: Frame, points: npt.ArrayLike, fill: Color, edge: Color | None = None) -> None:
    """Fill a polygon [n, 2] in a frame. With an edge color, draw its outline as well."""
    pixels = frame.points(points).tolist()
    pygame.draw.polygon(canvas, fill, pixels)
    if edge is not None:
        pygame.draw.polygon(canvas, edge, pixels, FINE)


def block(canvas: pygame.Surface, frame: Frame, box: Box, fill: Color) -> None:
    """Fill a box in a frame that is not turned."""
    pygame.draw.rect(canvas, fill, frame.box(*box))  # Surface.fill misplaces boxes that begin above the canvas


def disc(canvas: pygame.Surface, center: Array, radius: float, fill: Color, line: float = 0.0) -> None:
    """Fill a disc around a pixel [2], or draw a ring whose line lies inside the radius. All lengths are in px."""
    pygame.draw.circle(canvas, fill, np.rint(center).tolist(), round(radius), round(line))


def ellipse(x: float, y: float, radius_x: float, radius_y: float, corners: int = 24) -> Array:
    """Return an ellipse as a polygon, float64 [corners, 2]."""
    angle = np.linspace(0.0, 2 * np.pi, corners, endpoint=False)
    return np.stack([x + radius_x * np.cos(angle), y + radius_y * np.sin(angle)], axis=1)


def fade(canvas: pygame.Surface, box: pygame.Rect, top: Color, bottom: Color) -> None:
    """Fill a box of a canvas (px) with a vertical gradient."""
    canvas.blit(_gradient(box.width, box.height, top, bottom), box)


@lru_cache(maxsize=64)
def _gradient(width: int, height: int, top: Color, bottom: Color) -> pygame.Surface:
    gradient = pygame.Surface((width, height))
    for row in range(height):
        gradient.fill(pygame.Color(top).lerp(bottom, row / height), (0, row, width, 1))
    return gradient


def write(canvas: pygame.Surface, text: str, size: float, color: Color, x: float, y: float, align: float = 0.0) -> None:
    """Write a line of text `size` px high, centered at y. x is its left (align 0), middle (0.5) or right end (1)."""
    line = _font(round(size)).render(text, True, color)
    canvas.blit(line, (x - align * line.get_width(), y - line.get_height() / 2))


@lru_cache
def _font(size: int) -> pygame.font.Font:
    pygame.font.init()  # works without a display
    return pygame.font.Font(None, size)


def picture(canvas: pygame.Surface) -> Array:
    """Return the canvas scaled down by FINE, uint8 [height, width, 3]."""
    small = pygame.transform.smoothscale(canvas, (canvas.get_width() // FINE, canvas.get_height() // FINE))
    pixels = pygame.surfarray.pixels3d(small).swapaxes(0, 1)
    return np.stack([pixels[..., color] for color in range(3)], axis=-1)  # a fifth of the time of one strided copy
