"""Controls: which pointer, keys and gamepad act on which axes and branches, from the names in a spec alone.

A guess that a person can change in the page. Keys are named as in `KeyboardEvent.code`, buttons of the pointer Mouse0
(left), Mouse1 and Mouse2 (right), buttons of a gamepad Pad0, Pad1, … as in the standard gamepad.
"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from joybridge.v1 import bridge_pb2 as pb

# Words in the names of axes and choices.
HORIZONTAL = {"x", "dx", "vx", "horizontal"}
VERTICAL = {"y", "dy", "vy", "vertical"}
DEPTH = {"z", "dz", "vz"}  # vertical where there is no y
ANGLE = {"angle", "direction", "heading", "bearing"}
TURN = {"turn", "steer", "steering", "rudder", "wheel", "yaw", "rotate", "rotation"}
SPEED = {"speed", "velocity", "throttle", "gas", "thrust", "accelerate", "acceleration", "forward", "power", "force"}
MOVEMENT = {"dx", "dy", "dz", "vx", "vy", "vz", "velocity", "speed", "delta", "move", "movement", "motion"}
PLACE = {"position", "place", "pointer", "cursor", "mouse", "aim", "target", "point"}
ONCE = {"shoot", "fire", "reload", "blink", "jump", "dash", "click", "select", "use", "throw", "drop", "attack", "hit"}
REST = {"none", "rest", "released", "stay", "idle", "wait", "nothing", "noop", "neutral", "off", "pass", "hold"}

STICK_KEYS = (  # left, right, down, up
    (("KeyA", "ArrowLeft"), ("KeyD", "ArrowRight"), ("KeyS", "ArrowDown"), ("KeyW", "ArrowUp")),
    (("KeyJ",), ("KeyL",), ("KeyK",), ("KeyI",)),
)
WAYS = {"left": ("KeyA", "ArrowLeft", "Pad14"), "right": ("KeyD", "ArrowRight", "Pad15"),
        "down": ("KeyS", "ArrowDown", "Pad13"), "up": ("KeyW", "ArrowUp", "Pad12")}  # fmt: skip
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
        (index, pair, span)
        for index, behavior in enumerate(spec.behaviors)
        for pair, span in _pair_axes(behavior.device.axes)
    ]
    controls: list[Stick | Choice] = []
    for number, (index, pair, span) in enumerate(sticks):
        names = [spec.behaviors[index].device.axes[axis].name for axis in pair if axis is not None]
        left, right, down, up = STICK_KEYS[number] if number < len(STICK_KEYS) else ((), (), (), ())
        keys = (left, right, *((down, up) if pair[1] is not None else ((), ())))
        if pair[0] is None:
            keys = ((), (), down, up)
        pointer = "off" if number else _pointer(names, polar=span > 0)
        controls.append(Stick(index, pair, span, pointer, keys, number if number < 2 else -1))
    used = {key for control in controls if isinstance(control, Stick) for keys in control.keys for key in keys}
    for index, behavior in enumerate(spec.behaviors):
        for number, branch in enumerate(behavior.device.branches):
            rest = _rest(branch.choices)
            once = bool(set(_words(branch.name)) & ONCE)
            controls.append(Choice(index, number, rest, _choice_keys(branch, rest, used), once))
    return controls


def _words(name: str) -> list[str]:
    """Return the words of a name, as in "velocity_x", "moveX" and "left stick"."""
    return [word.lower() for word in re.findall(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])", name)]


def _pair_axes(axes: Sequence[pb.Axis]) -> Iterator[tuple[tuple[int | None, int | None], float]]:
    """Yield all axes, two together where their names say that they belong together; and the span of an angle."""
    words = [set(_words(axis.name)) for axis in axes]
    free = list(range(len(axes)))

    def first(kinds: set[str]) -> int | None:
        return next((axis for axis in free if words[axis] & kinds), None)

    def take(one: int | None, other: int | None) -> tuple[int | None, int | None]:
        free[:] = [axis for axis in free if axis not in (one, other)]
        return one, other

    if (angle := first(ANGLE)) is not None and (speed := first(SPEED)) is not None:
        yield take(angle, speed), 90.0 if axes[speed].low < 0 else 180.0
    for kinds in (VERTICAL, DEPTH):
        for one in [axis for axis in free if words[axis] & HORIZONTAL]:
            stem = words[one] - HORIZONTAL
            other = next((axis for axis in free if words[axis] & kinds and words[axis] - kinds == stem), None)
            if other is not None:
                yield take(one, other), 0.0
    if (turn := first(TURN)) is not None and (speed := first(SPEED)) is not None:
        yield take(turn, speed), 0.0
    for axis in [axis for axis in free if words[axis] & (VERTICAL | SPEED)]:
        yield take(None, axis), 0.0
    while free:
        one, *rest = free
        yield take(one, rest[0] if rest else None), 0.0


def _pointer(names: list[str], *, polar: bool) -> str:
    """Return what of the pointer moves these axes."""
    words = {word for name in names for word in _words(name)}
    if polar or (words & MOVEMENT and not words & TURN):
        return "movement"
    return "position" if words & PLACE or (len(names) == 2 and words <= HORIZONTAL | VERTICAL | DEPTH) else "stick"


def _rest(choices: Sequence[str]) -> int:
    """Return the choice that does nothing, by its name; otherwise the first."""
    return next((index for index, label in enumerate(choices) if set(_words(label)) & REST), 0)


def _choice_keys(branch: pb.Branch, rest: int, used: set[str]) -> list[Sequence[str]]:
    """Return the keys of each choice of a branch, none of which is in `used`, and add them to it.

    A choice that is a way has the keys of the arrows; one or two choices have buttons of the pointer; others digits.
    """
    button = len(branch.choices) == 2
    pressed = [index for index in range(len(branch.choices)) if index != rest or not (button or _is_rest(branch, rest))]
    keys: list[list[str]] = [[] for _ in branch.choices]
    presses = iter(press for press in PRESSES if not used & set(press))
    digits = iter(f"Digit{digit}" for digit in range(1, 10) if f"Digit{digit}" not in used)
    for index in pressed:
        way = next((WAYS[word] for word in _words(branch.choices[index]) if word in WAYS), None)
        if way and not used & set(way):
            keys[index] += way
        elif len(pressed) <= 2:
            keys[index] += next(presses, ())
        if not keys[index] or len(pressed) <= 2:
            keys[index] += [digit] if (digit := next(digits, None)) else []
    letter = f"Key{_words(branch.name)[0][0].upper()}" if button and _words(branch.name) else ""
    taken = used | {key for choice in keys for key in choice}
    if letter and letter not in taken and letter not in "KeyW KeyA KeyS KeyD KeyP":
        keys[pressed[0]].append(letter)
    used.update(key for choice in keys for key in choice)
    return list(keys)


def _is_rest(branch: pb.Branch, choice: int) -> bool:
    return bool(set(_words(branch.choices[choice])) & REST)
