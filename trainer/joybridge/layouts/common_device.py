"""One device for several games: a pointer, buttons and other choices, and where each game's device lies in it.

Parts of different games that do the same become one part of the common device:

    x, y          the axes that a game's names pair as horizontal and vertical, or a lone axis, which is horizontal
    x2, y2, …     further pairs
    button1, …    branches of two choices, in the order of the game: its main button first
    other names   an angle and a speed, and branches of more than two choices, with parts of the same name and choices

What is written by hand goes before these rules. Axes of the common device reach from -1 to 1, to the right and upwards:
those that say that their way is left or down are turned around. A game that lacks a part does not use it. This module
is pure: it knows devices, and no session.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

from joybridge.config.errors import ConfigError
from joybridge.layouts.device_names import pair_axes
from joybridge.v1 import bridge_pb2 as pb

BACKWARDS = (pb.WAY_LEFT, pb.WAY_DOWN)


class Placed(NamedTuple):
    """Where the parts of one game's device lie: for each axis and branch, the index in the common device."""

    axes: list[int]
    branches: list[int]
    signs: list[int]  # of each axis: -1 if its largest value is on the left or below


class Common(NamedTuple):
    """A common device, and the games in it."""

    device: pb.Device
    games: dict[str, Placed]

    def used_as(self, game: str, own: pb.Device) -> pb.Device:
        """Return the common device as a game uses it: its conditions, in names of the common device."""
        used, placed = pb.Device(), self.games[game]
        used.CopyFrom(self.device)
        branches = [branch.name for branch in own.branches]
        for index, axis in zip(placed.axes, own.axes, strict=True):
            if axis.HasField("only_with"):
                number = branches.index(axis.only_with.branch)
                choice = list(own.branches[number].choices).index(axis.only_with.choice)
                common = self.device.branches[placed.branches[number]]
                used.axes[index].only_with.CopyFrom(pb.Condition(branch=common.name, choice=common.choices[choice]))
        return used

    def lines(self, devices: Mapping[str, pb.Device]) -> Iterator[str]:
        """Yield a line for each part: what it is called in each game; games that do not use it are left out."""
        for index, axis in enumerate(self.device.axes):
            yield f"{axis.name} = {self._uses(devices, 'axes', index)}"
        for index, branch in enumerate(self.device.branches):
            yield f"{branch.name} ({' | '.join(branch.choices)}) = {self._uses(devices, 'branches', index)}"

    def _uses(self, devices: Mapping[str, pb.Device], kind: str, index: int) -> str:
        """Return which part of each game a part is; games without one are left out, a minus is before what turns."""
        uses = []
        for game, device in devices.items():
            for place, part in zip(getattr(self.games[game], kind), getattr(device, kind), strict=True):
                if place == index:
                    uses.append(f"{game}: {'-' if kind == 'axes' and part.way in BACKWARDS else ''}{part.name}")
        return ", ".join(uses)


def common_device(devices: Mapping[str, pb.Device], by_hand: Mapping[str, Sequence[str]]) -> Common:
    """Return the common device of games, given by name. by_hand: see the key `common_device`. Raises ConfigError."""
    chosen = _read(devices, by_hand)
    axes: dict[str, pb.Axis] = {}
    branches: dict[str, pb.Branch] = {}
    games = {}
    for game, device in devices.items():
        roles = _axis_roles(device, game, chosen), _branch_roles(device, game, chosen)
        for where in roles:
            if twice := next((role for role in where if where.count(role) > 1), ""):
                raise ConfigError(f"common_device.{twice}: it stands for two parts of the device of {game}; name one")
        for role, axis in zip(roles[0], device.axes, strict=True):
            known_axis = axes.setdefault(role, pb.Axis(name=role, low=-1.0, high=1.0, kind=axis.kind))
            known_axis.kind = _kind_of_both(known_axis.kind, axis.kind)
        for role, branch in zip(roles[1], device.branches, strict=True):
            known = branches.setdefault(role, pb.Branch(name=role))
            for label in branch.choices[len(known.choices) :]:
                known.choices.append(label if label not in known.choices else f"{label} ({len(known.choices)})")
        games[game] = roles
    if both := axes.keys() & branches.keys():
        raise ConfigError(f"common_device.{min(both)}: it stands for axes and for branches; name one kind of parts")
    places = {
        game: Placed(
            [[*axes].index(role) for role in of_axes],
            [[*branches].index(role) for role in of_branches],
            [-1 if axis.way in BACKWARDS else 1 for axis in devices[game].axes],
        )
        for game, (of_axes, of_branches) in games.items()
    }
    return Common(pb.Device(axes=axes.values(), branches=branches.values()), places)


def _read(devices: Mapping[str, pb.Device], by_hand: Mapping[str, Sequence[str]]) -> dict[tuple[str, str], str]:
    """Return the part of the common device for each part that is named by hand, (game, name). Raises ConfigError."""
    chosen: dict[tuple[str, str], str] = {}
    known = {
        (game, name)
        for game, one in devices.items()
        for name in (*(axis.name for axis in one.axes), *(branch.name for branch in one.branches))
    }
    for common, names in by_hand.items():
        for text in names:
            game, dot, name = text.rpartition(".")
            meant = [part for part in sorted(known) if part[1] == name and (not dot or part[0] == game)]
            if not meant:
                parts = ", ".join(f"{game}.{name}" for game, name in sorted(known))
                raise ConfigError(f"common_device.{common}: no game has {text!r}; there are {parts}")
            for part in meant:
                if part in chosen:
                    raise ConfigError(
                        f"common_device.{common}: {'.'.join(part)} stands under {chosen[part]} as well; leave one out"
                    )
                chosen[part] = common
    return chosen


def _kind_of_both(one: pb.AxisKind, other: pb.AxisKind) -> pb.AxisKind:
    """Return what an axis of two games is: what moves something in one of them cannot be placed."""
    if one == other:
        return one
    return pb.AXIS_KIND_VELOCITY if pb.AXIS_KIND_VELOCITY in (one, other) else pb.AXIS_KIND_UNSPECIFIED


def _axis_roles(device: pb.Device, game: str, chosen: Mapping[tuple[str, str], str]) -> list[str]:
    """Return the part of the common device for each axis."""
    free = [axis for axis in device.axes if (game, axis.name) not in chosen]
    roles = {axis.name: chosen[game, axis.name] for axis in device.axes if (game, axis.name) in chosen}
    counts = {"x": 0, "y": 0}
    for pair in pair_axes(free):
        for axis, letter in zip(pair.axes, counts, strict=True):
            if axis is None:
                continue
            if pair.span:  # an angle and a speed
                roles[free[axis].name] = free[axis].name
                continue
            counts[letter] += 1
            roles[free[axis].name] = f"{letter}{counts[letter]}" if counts[letter] > 1 else letter
    return [roles[axis.name] for axis in device.axes]


def _branch_roles(device: pb.Device, game: str, chosen: Mapping[tuple[str, str], str]) -> list[str]:
    """Return the part of the common device for each branch."""
    roles, buttons = [], 0
    for branch in device.branches:
        if (game, branch.name) in chosen:
            roles.append(chosen[game, branch.name])
        elif len(branch.choices) == 2:
            buttons += 1
            roles.append(f"button{buttons}")
        else:
            roles.append(branch.name)
    return roles
