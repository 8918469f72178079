"""What a spec says about a device: which axes belong together, what they move, which choice does nothing.

Axes may say their kind and their way; of others, and of choices, the names are a guess.
"""

import re
from collections.abc import Iterator, Sequence
from typing import NamedTuple

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
WAYS = {pb.WAY_RIGHT: 0, pb.WAY_LEFT: 0, pb.WAY_UP: 1, pb.WAY_DOWN: 1}  # 0 horizontal, 1 vertical
REST = {"none", "rest", "released", "stay", "idle", "wait", "nothing", "noop", "neutral", "off", "pass", "hold"}


class AxisPair(NamedTuple):
    """One axis or two that are used together."""

    axes: tuple[int | None, int | None]  # horizontal and vertical; if `span` is not 0, the angle and the speed
    span: float  # degrees between 0 and the end of the range of the angle; 0: the axes are horizontal and vertical
    sets: str  # what of a pointer: its "movement", its "position", or its offset as a "stick", also if nothing is known
    invert: tuple[bool, bool]  # whether the largest value is on the left, and whether it is below


def words(name: str) -> list[str]:
    """Return the words of a name, as in "velocity_x", "moveX" and "left stick"."""
    return [word.lower() for word in re.findall(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])", name)]


def pair_axes(axes: Sequence[pb.Axis]) -> list[AxisPair]:
    """Return all axes, two together where they or their names say so; those that say nothing, two by two."""
    pairs = []
    for pair, span in _pairs(axes):
        own = [axes[axis] for axis in pair if axis is not None]
        ways = {axis.way for axis in own}
        inverted = (pb.WAY_LEFT in ways, pb.WAY_DOWN in ways)
        pairs.append(AxisPair(pair, span, _sets(own, polar=span > 0), inverted))
    return pairs


def rest_choice(choices: Sequence[str]) -> int | None:
    """Return the first choice whose name says that it does nothing, None if there is none."""
    return next((index for index, label in enumerate(choices) if set(words(label)) & REST), None)


def _pairs(axes: Sequence[pb.Axis]) -> Iterator[tuple[tuple[int | None, int | None], float]]:
    """Yield the axes and the span of each pair."""
    known = [set(words(axis.name)) for axis in axes]
    free = list(range(len(axes)))

    def first(kinds: set[str]) -> int | None:
        return next((axis for axis in free if known[axis] & kinds), None)

    def take(one: int | None, other: int | None) -> tuple[int | None, int | None]:
        free[:] = [axis for axis in free if axis not in (one, other)]
        return one, other

    for one in [axis for axis in free if WAYS.get(axes[axis].way) == 0]:
        alike = (axis for axis in free if WAYS.get(axes[axis].way) == 1 and axes[axis].kind == axes[one].kind)
        if (other := next(alike, None)) is not None:
            yield take(one, other), 0.0
    for axis in [axis for axis in free if WAYS.get(axes[axis].way) == 1]:
        yield take(None, axis), 0.0
    if (angle := first(ANGLE)) is not None and (speed := first(SPEED)) is not None:
        yield take(angle, speed), 90.0 if axes[speed].low < 0 else 180.0
    for kinds in (VERTICAL, DEPTH):
        for one in [axis for axis in free if known[axis] & HORIZONTAL]:
            stem = known[one] - HORIZONTAL
            other = next((axis for axis in free if known[axis] & kinds and known[axis] - kinds == stem), None)
            if other is not None:
                yield take(one, other), 0.0
    if (turn := first(TURN)) is not None and (speed := first(SPEED)) is not None:
        yield take(turn, speed), 0.0
    for axis in [axis for axis in free if known[axis] & (VERTICAL | SPEED)]:
        yield take(None, axis), 0.0
    while free:
        one, *rest = free
        yield take(one, rest[0] if rest else None), 0.0


def _sets(axes: Sequence[pb.Axis], *, polar: bool) -> str:
    """Return what of a pointer some axes set: what they say, or what their names say."""
    kinds = {axis.kind for axis in axes}
    if not polar and pb.AXIS_KIND_VELOCITY in kinds:
        return "movement"
    if not polar and kinds & {pb.AXIS_KIND_POSITION, pb.AXIS_KIND_ANGLE}:
        return "position"
    known = {word for axis in axes for word in words(axis.name)}
    if polar or (known & MOVEMENT and not known & TURN):
        return "movement"
    return "position" if known & PLACE or (len(axes) == 2 and known <= HORIZONTAL | VERTICAL | DEPTH) else "stick"
