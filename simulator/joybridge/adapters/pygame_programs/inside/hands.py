"""A virtual pointer and keyboard in the place of the real ones: events and polled states alike."""

from collections.abc import Callable, Collection
from functools import partial
from typing import Any

import pygame

from joybridge.adapters.pygame_programs.inside.clock import MILLISECOND, Clock, post
from joybridge.adapters.pygame_programs.inside.frames import Frames

BUTTONS = {"left": 1, "middle": 2, "right": 3}  # of the mouse, by pygame's numbers
KEYS = {name[2:]: getattr(pygame, name) for name in dir(pygame) if name.startswith("K_")}
SCANCODES = 512  # of the states that get_pressed returns
JUST = {"get_just_pressed": True, "get_just_released": False}  # functions of pygame-ce
MODIFIERS = {
    pygame.K_LSHIFT: pygame.KMOD_LSHIFT,
    pygame.K_RSHIFT: pygame.KMOD_RSHIFT,
    pygame.K_LCTRL: pygame.KMOD_LCTRL,
    pygame.K_RCTRL: pygame.KMOD_RCTRL,
    pygame.K_LALT: pygame.KMOD_LALT,
    pygame.K_RALT: pygame.KMOD_RALT,
}
CONTROLS = {pygame.K_RETURN: "\r", pygame.K_TAB: "\t", pygame.K_BACKSPACE: "\b", pygame.K_ESCAPE: "\x1b"}
SCAN_OF_KEY = {  # by the names that pygame gives both
    key: getattr(pygame, f"KSCAN_{name.upper()}")
    for name, key in KEYS.items()
    if hasattr(pygame, f"KSCAN_{name.upper()}")
}


class Hands:
    """Where the pointer is, and what is pressed."""

    def __init__(self, clock: Clock, frames: Frames) -> None:
        """Take the place of the functions of pygame.mouse and pygame.key."""
        self.clock, self._frames = clock, frames
        self.position = (0, 0)
        self.buttons: set[int] = set()
        self.keys: set[int] = set()
        self._moved = (0, 0)  # since the program last asked
        self._visible, self._grabbed = True, False
        self._changes: dict[tuple[str, int, bool], int] = {}  # of keys and buttons, pressed or released: in which frame
        self._repeat = (0, 0)  # delay and interval of held keys, in nanoseconds
        self._repeats: dict[int, int] = {}  # by key: when it is due
        self._mods = 0
        self.key_shown: Callable[[int], int] = int  # what events and states show; see watching.py
        self.states_shown: Callable[[list[bool]], Any] = getattr(pygame.key, "ScancodeWrapper", KeyStates)
        self._replace_mouse()
        self._replace_keys()
        clock.watchers.append(self._repeat_keys)

    def press_buttons(self, buttons: Collection[int]) -> None:
        """Hold exactly these buttons of the mouse."""
        for button in sorted(self.buttons.symmetric_difference(buttons)):
            down = button in buttons
            self.buttons = self.buttons | {button} if down else self.buttons - {button}
            self._changes["mouse", button, down] = self._frames.count
            kind = pygame.MOUSEBUTTONDOWN if down else pygame.MOUSEBUTTONUP
            self._post(kind, pos=self.position, button=button, touch=False)

    def turn_wheel(self, ticks: int) -> None:
        """Turn the wheel, away from the hand if positive."""
        button = 4 if ticks > 0 else 5
        for kind in (pygame.MOUSEBUTTONDOWN, pygame.MOUSEBUTTONUP):
            self._post(kind, pos=self.position, button=button, touch=False)
        self._post(pygame.MOUSEWHEEL, flipped=False, x=0, y=ticks, precise_x=0.0, precise_y=float(ticks), touch=False)

    def move(self, x: float, y: float) -> None:
        """Move the pointer to a pixel, within the display."""
        width, height = _size()
        goal = (min(max(int(x), 0), width - 1), min(max(int(y), 0), height - 1))
        step = (goal[0] - self.position[0], goal[1] - self.position[1])
        if self.captured:  # then the window's edges stop nothing
            step = (int(x) - self.position[0], int(y) - self.position[1])
        if step == (0, 0):
            return
        self.position = goal
        self._moved = (self._moved[0] + step[0], self._moved[1] + step[1])
        self._post(pygame.MOUSEMOTION, pos=goal, rel=step, buttons=self._button_states(3), touch=False)

    def press_keys(self, keys: Collection[int]) -> None:
        """Hold exactly these keys."""
        for key in sorted(self.keys.symmetric_difference(keys)):
            self._changes["key", key, key in keys] = self._frames.count
            if key in keys:
                self.keys = self.keys | {key}
                self._mods |= MODIFIERS.get(key, 0)
                self._press(key)
                if self._repeat[0]:
                    self._repeats[key] = self.clock.now + self._repeat[0]
            else:
                self.keys = self.keys - {key}
                self._mods &= ~MODIFIERS.get(key, 0)
                self._repeats.pop(key, None)
                self._post(pygame.KEYUP, **self._key(key))

    @property
    def captured(self) -> bool:
        """Return whether the program has hidden the pointer and holds it in its window, as for looking around."""
        return not self._visible and self._grabbed

    def _press(self, key: int) -> None:
        fields = self._key(key)
        self._post(pygame.KEYDOWN, **fields)
        if fields["unicode"].isprintable() and fields["unicode"]:
            self._post(pygame.TEXTINPUT, text=fields["unicode"])

    def _key(self, key: int) -> dict[str, Any]:
        text = chr(key) if 32 <= key < 127 else CONTROLS.get(key, "")
        if self._mods & pygame.KMOD_SHIFT:
            text = text.upper()
        return {"key": self.key_shown(key), "mod": self._mods, "unicode": text, "scancode": SCAN_OF_KEY.get(key, 0)}

    def _post(self, kind: int, **fields: Any) -> None:
        post(pygame.event.Event(kind, **fields, window=None))

    def _repeat_keys(self) -> None:
        for key, due in self._repeats.items():
            while due <= self.clock.now:
                due += max(self._repeat[1], MILLISECOND)
                self._press(key)
            self._repeats[key] = due

    def _button_states(self, count: int) -> tuple[bool, ...]:
        return tuple(button in self.buttons for button in range(1, count + 1))

    def _key_states(self, keys: Collection[int]) -> Any:
        held = [False] * SCANCODES
        for key in keys:
            held[SCAN_OF_KEY.get(key, 0)] = True
        return self.states_shown(held)

    def _changed(self, kind: str, *, down: bool) -> set[int]:
        """Return which keys or buttons have been pressed, or released, at the end of the last frame."""
        self._frames.asked = True
        now = self._frames.count
        return {part for (what, part, pressed), at in self._changes.items() if (what, pressed, at) == (kind, down, now)}

    def _replace_mouse(self) -> None:
        mouse = pygame.mouse

        def get_pos() -> tuple[int, int]:
            self._frames.asked = True
            return self.position

        def get_rel() -> Any:
            self._frames.asked = True
            moved, self._moved = self._moved, (0, 0)
            return moved

        def get_pressed(num_buttons: int = 3) -> Any:
            self._frames.asked = True
            return self._button_states(num_buttons)

        def set_pos(*place: Any) -> None:
            self.move(*(place if len(place) == 2 else place[0]))

        def set_visible(value: Any) -> bool:
            before, self._visible = self._visible, bool(value)
            return before

        grab = pygame.event.set_grab  # which has no effect on a window that is not shown

        def set_grab(grabbed: Any) -> None:
            self._grabbed = bool(grabbed)
            grab(grabbed)

        pygame.event.set_grab, pygame.event.get_grab = set_grab, lambda: self._grabbed
        for function in (get_pos, get_rel, get_pressed, set_pos, set_visible):
            setattr(mouse, function.__name__, function)
        mouse.get_visible = lambda: self._visible
        mouse.get_focused = lambda: True
        for name in ("set_cursor", "set_system_cursor"):
            setattr(mouse, name, lambda *_: None)
        for name, down in JUST.items():
            if hasattr(mouse, name):
                setattr(mouse, name, partial(self._just_buttons, down=down))

    def _just_buttons(self, *, down: bool) -> tuple[bool, ...]:
        changed = self._changed("mouse", down=down)
        return tuple(button in changed for button in range(1, 4))

    def _replace_keys(self) -> None:
        def get_pressed() -> Any:
            self._frames.asked = True
            return self._key_states(self.keys)

        def set_repeat(delay: int = 0, interval: int = 0) -> None:
            self._repeat = (int(delay) * MILLISECOND, int(interval or delay) * MILLISECOND)
            self._repeats.clear()

        def set_mods(mods: int) -> None:
            self._mods = mods

        for function in (get_pressed, set_repeat, set_mods):
            setattr(pygame.key, function.__name__, function)
        pygame.key.get_mods = lambda: self._mods
        pygame.key.get_focused = lambda: True
        for name, down in JUST.items():
            if hasattr(pygame.key, name):
                setattr(pygame.key, name, lambda down=down: self._key_states(self._changed("key", down=down)))
        pygame.key.get_repeat = lambda: (self._repeat[0] // MILLISECOND, self._repeat[1] // MILLISECOND)


class KeyStates(tuple[bool, ...]):
    """What get_pressed returns, for versions of pygame whose own type cannot be made: indexed by keys."""

    def __getitem__(self, key: Any) -> Any:
        return super().__getitem__(SCAN_OF_KEY.get(key, 0))


def _size() -> tuple[int, int]:
    surface = pygame.display.get_surface()
    return surface.get_size() if surface else (1, 1)
