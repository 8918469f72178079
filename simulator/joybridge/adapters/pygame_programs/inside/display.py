"""The display: a surface in memory that nothing shows, and refusals of what cannot be drawn there."""

from typing import Any

import numpy as np
import numpy.typing as npt
import pygame

Pixels = npt.NDArray[np.uint32]

NOTHING = pygame.Rect(0, 0, 0, 0)  # of the display that is drawn on
WHOLE_SCREEN = (1280, 720)  # of a program that asks for the size of the desktop
CANNOT_DRAW = {  # modules whose drawing does not end in a surface, or that need a device which is not there
    "OpenGL": "OpenGL",
    "moderngl": "OpenGL",
    "moderngl_window": "OpenGL",
    "zengl": "OpenGL",
    "pyglet": "OpenGL",
    "pygame.camera": "a camera",
    "pygame._camera": "a camera",
    "cv2": "OpenCV's windows and cameras",
}


class Refused(BaseException):
    """The program cannot be run here. The text says why. No `except Exception` of the program stops it."""


class Display:
    """The surface that the program draws on."""

    def __init__(self, *, window: bool = False) -> None:
        """Take the place of set_mode and what changes a window. window: leave both as they are."""
        self._set_mode = pygame.display.set_mode
        self._clip = NOTHING  # of the program, while nothing is drawn
        if window:
            return
        pygame.display.set_mode = self.set_mode
        pygame.display.toggle_fullscreen = lambda: 1
        pygame.display.iconify = lambda: False
        pygame.display.get_active = lambda: True

    def set_mode(
        self, size: Any = (0, 0), flags: int = 0, depth: int = 0, display: int = 0, vsync: int = 0
    ) -> pygame.Surface:
        """Return a surface in memory; scaling, full screen and the pace of a monitor make no difference."""
        if flags & pygame.OPENGL:
            raise Refused("the program draws with OpenGL; only programs that draw on pygame's surfaces can be run")
        width, height = (int(side) for side in size)
        if width <= 0 or height <= 0:
            width, height = WHOLE_SCREEN
        return self._set_mode((width, height), flags & pygame.RESIZABLE, 32)

    def draw(self, wanted: bool) -> None:
        """Let the next frame be drawn, or let nothing that the program draws come onto the display."""
        surface = pygame.display.get_surface()
        if surface is None:
            return
        clip = surface.get_clip()
        if wanted and clip == NOTHING:
            surface.set_clip(self._clip)
        elif not wanted and clip != NOTHING:
            self._clip = clip
            surface.set_clip(NOTHING)

    def pixels(self) -> Pixels:
        """Return the present picture as 0x00RRGGBB, uint32 [height, width], without a copy where possible."""
        surface = pygame.display.get_surface()
        if surface is None:
            return np.zeros((1, 1), np.uint32)
        width, height = surface.get_size()
        if surface.get_bytesize() != 4 or surface.get_masks()[:3] != (0xFF0000, 0xFF00, 0xFF):
            surface = surface.convert((0xFF0000, 0xFF00, 0xFF, 0))
        buffer: Any = surface.get_buffer()
        rows: Pixels = np.frombuffer(buffer, np.uint32).reshape(height, surface.get_pitch() // 4)
        return rows[:, :width]
