"""Controls: which pointer, keys and gamepad act on which axes and branches, from what a spec says and from its names.

A proposal that a person can change in the page. Keys are named as in `KeyboardEvent.code`, buttons of the pointer
Mouse0 (left), Mouse1 and Mouse2 (right), buttons of a gamepad Pad0, Pad1, … as in the standard gamepad.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from joybridge.layouts.device_names import pair_axes, rest_choice, words
from joybridge.v1 import bridge_pb2 as pb

# Words in the names of branches.
ONCE = {"shoot", "fire", "reload", "blink", "jump", "dash", "click", "select", "use", "throw", "drop", "attack", "hit"}

STICK_KEYS = (  # left, right, down, up
    (("KeyA", "ArrowLeft"), ("KeyD", "ArrowRight"), ("KeyS", "ArrowDown"), ("KeyW", "ArrowUp")),
    (("KeyJ",), ("KeyL",), ("KeyK",), ("KeyI",)),
)
WAYS = {
    "left": ("KeyA", "ArrowLeft", "Pad14"),
    "right": ("KeyD", "ArrowRight", "Pad15"),
    "down": ("KeyS", "ArrowDown", "Pad13"),
    "up": ("KeyW", "ArrowUp", "Pad12"),
}
PRESSES = (("Mouse0", "Space", "Pad0"), ("Mouse2", "KeyE", "Pad1"), ("Mouse1", "KeyQ", "Pad2"), ("ShiftLeft", "Pad3"))


@dataclass
class Stick:
    """What moves one axis or two together."""

    behavior: int
    axes: tuple[int | None, int | None]  # horizontal and vertical; if `span` is not 0, the angle and the speed
    span: float  # degrees between 0 and the end of the range of the angle; 0: the axes are horizontal and vertical
    pointer: (
        str  # what of the pointer: its "movement", its "position" in the picture, its offset as a "stick", or "off"
    )
    keys: tuple[Sequence[str], Sequence[str], Sequence[str], Sequence[str]]  # left, right, down, up
    pad: int  # which stick of the gamepad: 0 left, 1 right, -1 none
    invert: tuple[bool, bool] = (False, False)  # horizontally and vertically
    sensitivity: float = 1.0  # of the pointer's movement


@dataclass
class Choice:
    """What selects a choice of a branch."""

    behavior: int
    branch: int
    rest: int  # the choice where nothing is pressed
    keys: list[Sequence[str]]  # per choice
    once: bool  # a press lasts for one decision, not until the key is released


def make_controls(spec: pb.GameSpec) -> list[Stick | Choice]:
    """Return a control for every axis and branch of a game: first the sticks, then the choices."""
    sticks = [
        (index, pair) for index, behavior in enumerate(spec.behaviors) for pair in pair_axes(behavior.device.axes)
    ]
    said = {key for behavior in spec.behaviors for branch in behavior.device.branches for key in branch.keys if key}
    controls: list[Stick | Choice] = []
    for number, (index, pair) in enumerate(sticks):
        left, right, down, up = STICK_KEYS[number] if number < len(STICK_KEYS) else ((), (), (), ())
        keys = (left, right, *((down, up) if pair.axes[1] is not None else ((), ())))
        if pair.axes[0] is None:
            keys = ((), (), down, up)
        ours = [[key for key in way if key not in said] for way in keys]
        pointer, pad = "off" if number else pair.sets, number if number < 2 else -1
        controls.append(
            Stick(index, pair.axes, pair.span, pointer, (ours[0], ours[1], ours[2], ours[3]), pad, pair.invert)
        )
    used = said | {key for control in controls if isinstance(control, Stick) for keys in control.keys for key in keys}
    for index, behavior in enumerate(spec.behaviors):
        for number, branch in enumerate(behavior.device.branches):
            once = bool(set(words(branch.name)) & ONCE)
            rest = rest_choice(branch.choices) or 0
            controls.append(Choice(index, number, rest, _choice_keys(branch, rest, used), once))
    return controls


def _choice_keys(branch: pb.Branch, rest: int, used: set[str]) -> list[Sequence[str]]:
    """Return the keys of each choice of a branch, none of which is in `used`, and add them to it.

    Keys that the spec says come first; a button of the gamepad joins that of a button. Otherwise: a choice that is
    a way has the keys of the arrows; one or two choices have buttons of the pointer; others digits.
    """
    button = len(branch.choices) == 2
    rests = button or rest_choice(branch.choices) is not None
    if branch.keys:
        own = [[key] if key else [] for key in branch.keys]
        if button and (pad := next((press[-1] for press in PRESSES if press[-1] not in used), "")):
            own[1].append(pad)
            used.add(pad)
        return list(own)
    pressed = [index for index in range(len(branch.choices)) if index != rest or not rests]
    keys: list[list[str]] = [[] for _ in branch.choices]
    presses = iter(press for press in PRESSES if not used & set(press))
    digits = iter(f"Digit{digit}" for digit in range(1, 10) if f"Digit{digit}" not in used)
    for index in pressed:
        way = next((WAYS[word] for word in words(branch.choices[index]) if word in WAYS), None)
        if way and not used & set(way):
            keys[index] += way
        elif len(pressed) <= 2:
            keys[index] += next(presses, ())
        if not keys[index] or len(pressed) <= 2:
            keys[index] += [digit] if (digit := next(digits, None)) else []
    letter = f"Key{words(branch.name)[0][0].upper()}" if button and words(branch.name) else ""
    taken = used | {key for choice in keys for key in choice}
    if letter and letter not in taken and letter not in "KeyW KeyA KeyS KeyD KeyP":
        keys[pressed[0]].append(letter)
    used.update(key for choice in keys for key in choice)
    return list(keys)
