"""Let a policy that `joybridge export RUN policy.json` wrote play a pygame program in the program's own window.

    python play_pygame.py my_game.py policy.json

Copy this file and policy.py into one folder; they need NumPy and pygame alone. What the policy does comes to the
program as events and states of the mouse and the keys; everything else is as without it. Close the window to end it.
"""

import argparse
import runpy
import sys
import time
from pathlib import Path

import numpy as np
import pygame
from policy import Policy

SENSORS = ("screen", "fovea")
SPEED = 0.04  # of a pointer that is moved: widths of the display per frame, at most
SAMPLES = 4  # of the picture for a pixel of a sensor, along each side, at most
GRAY = np.array([77, 150, 29], np.uint32)  # parts of 256 of red, green and blue
BUTTONS = {"mouse_left": 1, "mouse_middle": 2, "mouse_right": 3}
SIZE = 512  # of what get_pressed returns


def main():
    """Run the command line."""
    parser = argparse.ArgumentParser(description="Let an exported policy play a pygame program.")
    parser.add_argument("program", help="a file of Python; arguments of its own may follow")
    parser.add_argument("policy", help="policy.json, exported from the run of a training on this program")
    parser.add_argument("--seed", type=int, help="of the samples of the policy; default: another one each time")
    options, own = parser.parse_known_args()
    if not Path(options.program).is_file():
        parser.error(f"there is no file {options.program}")
    try:
        player = Player(Policy(options.policy), np.random.default_rng(options.seed))
    except (OSError, ValueError) as error:
        parser.error(str(error))
    player.take_part()
    sys.argv = [options.program, *own]
    sys.path.insert(0, str(Path(options.program).resolve().parent))
    try:
        runpy.run_path(options.program, run_name="__main__")
    except KeyboardInterrupt:
        sys.exit(130)
    finally:
        print(player.pace(), file=sys.stderr)


class Player:
    """Sees the frames that the program shows, and moves and presses what the policy says."""

    def __init__(self, policy, random):
        """Begin an episode. Raises ValueError if the policy sees more than a picture, or holds a joystick."""
        self.policy, self.random = policy, random
        names = [part["name"] for part in (*policy.axes, *policy.branches)]
        unknown = [each["name"] for each in policy.sensors if each["name"] not in SENSORS]
        unknown += [name for name in names if not name.startswith(("pointer_", "mouse_", "key_")) and name != "wheel"]
        if unknown:
            raise ValueError(f"the policy has {unknown[0]}, which is not of the picture, the mouse or the keys")
        self.state = policy.begin(lanes=1)
        self.every, self.frames = int(policy.options.get("decision_interval", 4)), 0
        self.begin = time.monotonic()
        self.place, self.speed = np.full(2, 0.5), np.zeros(2)  # of the pointer, as parts of the display
        self.position, self.moved = (0, 0), (0, 0)
        self.buttons, self.keys = set(), set()

    def take_part(self):
        """Take the place of what shows a frame, and of what asks where the mouse is and what is pressed."""
        for name in ("flip", "update"):
            setattr(pygame.display, name, self.after(getattr(pygame.display, name)))
        held = {part["name"].partition("_")[0] for part in (*self.policy.axes, *self.policy.branches)}
        if "pointer" in held:
            pygame.mouse.get_pos = lambda: self.position
            pygame.mouse.get_rel = self.get_rel
        if "mouse" in held:
            pygame.mouse.get_pressed = lambda count=3: tuple(number in self.buttons for number in range(1, count + 1))
        if "key" in held:
            pygame.key.get_pressed = lambda: Pressed(self.keys)

    def after(self, show):
        """Return what shows a frame and then lets the policy see it."""

        def shown(*arguments):
            show(*arguments)
            if pygame.display.get_surface() is None:  # the program is about to end
                return
            if self.frames % self.every == 0:
                self.decide()
            else:
                self.move()
            self.frames += 1

        return shown

    def decide(self):
        """Do what the policy says about the picture."""
        pixels = pygame.surfarray.array3d(pygame.display.get_surface()).swapaxes(0, 1)
        seen = {each["name"]: self.look(pixels, each["name"], each["shape"])[None] for each in self.policy.sensors}
        axes, choices, self.state = self.policy.act(seen, self.state, self.random)
        axes = {axis["name"]: float(value) for axis, value in zip(self.policy.axes, axes[0], strict=True)}
        if "pointer_x" in axes:
            self.place = np.array([axes["pointer_x"] * 0.5 + 0.5, axes["pointer_y"] * -0.5 + 0.5])
        elif "pointer_velocity_x" in axes:
            self.speed = np.array([axes["pointer_velocity_x"], -axes["pointer_velocity_y"]]) * SPEED
        self.move()
        chosen = {branch["name"]: int(choice) for branch, choice in zip(self.policy.branches, choices[0], strict=True)}
        pressed = [name for name, choice in chosen.items() if choice and name != "wheel"]
        self.press_buttons({BUTTONS[name] for name in pressed if name in BUTTONS})
        self.press_keys({getattr(pygame, f"K_{name[4:]}") for name in pressed if name not in BUTTONS})
        if turned := chosen.get("wheel"):
            for kind in (pygame.MOUSEBUTTONDOWN, pygame.MOUSEBUTTONUP):
                post(kind, pos=self.position, button=(0, 4, 5)[turned], touch=False)
            post(pygame.MOUSEWHEEL, flipped=False, x=0, y=(0, 1, -1)[turned], touch=False)

    def look(self, pixels, name, shape):
        """Return a sensor of a picture, uint8 `shape`, as the training saw it. pixels: uint8 [height, width, 3]."""
        height, width, colors = shape
        if name == "fovea":
            x, y = self.position
            reach = ((height, height), (width, width), (0, 0))
            pixels = np.pad(pixels, reach)[y + height - height // 2 :, x + width - width // 2 :][:height, :width]
        rows, columns = samples(pixels.shape[0], height), samples(pixels.shape[1], width)
        blocks = pixels[rows.ravel()][:, columns.ravel()].reshape(*rows.shape, *columns.shape, 3)
        picture = blocks.sum(axis=(1, 3), dtype=np.uint32) // (rows.shape[1] * columns.shape[1])
        if colors == 1:
            picture = (picture @ GRAY >> 8)[..., None]
        return picture.astype(np.uint8)

    def move(self):
        """Move the pointer for a frame."""
        width, height = pygame.display.get_surface().get_size()
        self.place = np.clip(self.place + self.speed * (1.0, width / height), 0.0, 1.0)
        x, y = (int(value) for value in self.place * (width - 1, height - 1))
        step = (x - self.position[0], y - self.position[1])
        if step == (0, 0) or not self.policy.axes:
            return
        self.position, self.moved = (x, y), (self.moved[0] + step[0], self.moved[1] + step[1])
        held = tuple(int(number in self.buttons) for number in (1, 2, 3))
        post(pygame.MOUSEMOTION, pos=self.position, rel=step, buttons=held, touch=False)

    def press_buttons(self, buttons):
        """Hold exactly these buttons of the mouse."""
        changed, self.buttons = sorted(self.buttons ^ buttons), buttons
        for button in changed:
            kind = pygame.MOUSEBUTTONDOWN if button in buttons else pygame.MOUSEBUTTONUP
            post(kind, pos=self.position, button=button, touch=False)

    def press_keys(self, keys):
        """Hold exactly these keys."""
        changed, self.keys = sorted(self.keys ^ keys), keys
        for key in changed:
            text = chr(key) if 32 <= key < 127 else ""
            post(pygame.KEYDOWN if key in keys else pygame.KEYUP, key=key, mod=0, unicode=text, scancode=0)
            if key in keys and text:
                post(pygame.TEXTINPUT, text=text)

    def pace(self):
        """Return how fast the program was played: a policy that decides less often than in its training plays worse."""
        seconds = max(time.monotonic() - self.begin, 1e-9)
        return f"{self.frames} frames, {self.frames / seconds:.1f} per second, and a decision every {self.every}"

    def get_rel(self):
        """Return how far the pointer was moved since the program last asked."""
        moved, self.moved = self.moved, (0, 0)
        return moved


class Pressed(tuple):
    """What get_pressed of the keys returns: whether each is held, by its number in pygame."""

    def __new__(cls, keys):
        """Make it. keys: the numbers of those that are held."""
        made = super().__new__(cls, [True] * len(keys) + [False] * (SIZE - len(keys)))  # as any() and all() take it
        made.keys = set(keys)
        return made

    def __getitem__(self, key):
        """Return whether a key is held."""
        return key in self.keys


def samples(pixels, wanted):
    """Return the indices of the samples along a side, [wanted, samples]."""
    each = min(max(pixels // wanted, 1), SAMPLES)
    return ((2 * np.arange(wanted * each) + 1) * pixels // (2 * wanted * each)).reshape(wanted, each)


def post(kind, **fields):
    """Give the program an event."""
    pygame.event.post(pygame.event.Event(kind, fields))


if __name__ == "__main__":
    main()
