"""A virtual joystick in the place of those of pygame: one stick, and some buttons."""

from collections.abc import Collection
from typing import Any

import pygame

from joybridge.adapters.pygame_programs.inside.clock import post
from joybridge.adapters.pygame_programs.inside.frames import Frames
from joybridge.adapters.pygame_programs.wire import STICK_BUTTONS


class Joysticks:
    """Where the stick is, and which buttons are pressed."""

    def __init__(self, frames: Frames) -> None:
        """Take the place of pygame.joystick. Nothing is plugged in."""
        self.plugged = False
        self._axes = [0.0, 0.0]
        self._buttons: set[int] = set()
        sticks = self

        class Joystick:
            """pygame.joystick.Joystick."""

            def __init__(self, id: int = 0) -> None:
                if not sticks.plugged or id != 0:
                    raise pygame.error("Invalid joystick device number")

            def get_axis(self, axis_number: int) -> float:
                frames.asked = True
                return sticks._axes[axis_number] if 0 <= axis_number < 2 else 0.0

            def get_button(self, button: int) -> bool:
                frames.asked = True
                return button in sticks._buttons

        answers = {
            "init": None,
            "quit": None,
            "get_init": True,
            "get_id": 0,
            "get_instance_id": 0,
            "get_guid": "0" * 32,
            "get_name": "joystick",
            "get_numaxes": 2,
            "get_numbuttons": STICK_BUTTONS,
            "get_numhats": 0,
            "get_numballs": 0,
            "get_power_level": "wired",
            "rumble": False,
            "stop_rumble": None,
            "get_hat": (0, 0),
        }
        for name, answer in answers.items():
            setattr(Joystick, name, lambda *_, answer=answer: answer)
        pygame.joystick.Joystick = pygame.joystick.JoystickType = Joystick
        pygame.joystick.get_count = lambda: int(self.plugged)
        pygame.joystick.init = pygame.joystick.quit = lambda: None
        pygame.joystick.get_init = lambda: True

    def move(self, x: float, y: float) -> None:
        """Move the stick; y is downwards, as in pygame."""
        for axis, value in enumerate((x, y)):
            if value != self._axes[axis]:
                self._axes[axis] = value
                self._post(pygame.JOYAXISMOTION, axis=axis, value=value)

    def press(self, buttons: Collection[int]) -> None:
        """Hold exactly these buttons."""
        for button in sorted(self._buttons.symmetric_difference(buttons)):
            kind = pygame.JOYBUTTONDOWN if button in buttons else pygame.JOYBUTTONUP
            self._post(kind, button=button)
        self._buttons = set(buttons)

    def _post(self, kind: int, **fields: Any) -> None:
        post(pygame.event.Event(kind, joy=0, instance_id=0, **fields))
