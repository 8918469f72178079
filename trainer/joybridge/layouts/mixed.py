"""Names of layouts with commas: other layouts for single axes, branches and behaviors.

"bucket-11, angle=bucket-21-mu, shoot=hybrid" is bucket-11, but for the axis `angle` and the branch `shoot`. In a game
of several behaviors, "hybrid, hunter=bucket-5, hunter.turn=hybrid" differs for one of them.
"""

from typing import NamedTuple

from joybridge.config.errors import ConfigError
from joybridge.layouts.find import find_layouts
from joybridge.layouts.layout import Layout, together
from joybridge.layouts.targets import relocate
from joybridge.v1 import bridge_pb2 as pb


class Mix(NamedTuple):
    """A layout, and those that differ, by the names of axes, branches and behaviors."""

    main: str
    others: dict[str, str]


def read_mix(name: str) -> Mix:
    """Return what a name of layouts says. Raises ConfigError."""
    main, *pairs = (text.strip() for text in name.split(","))
    others: dict[str, str] = {}
    for pair in pairs:
        part, equals, layout = (text.strip() for text in pair.rpartition("="))
        if not equals or not part or not layout:
            raise ConfigError(f"layout: got {pair!r} in {name!r}, expected NAME=LAYOUT after a comma")
        if part in others:
            raise ConfigError(f"layout: {part!r} stands twice in {name!r}")
        others[part] = layout
    return Mix(main, others)


def kinds_of(name: str) -> set[str]:
    """Return the kinds of layouts in a name: "bucket" of "bucket-11", or "module:name" of those that users make."""
    return {part.rpartition("=")[2].strip().partition("-")[0] for part in name.split(",")}


def make_layouts(name: str, device: pb.Device, behavior: str = "") -> dict[str, Layout]:
    """Return the layouts called `name` ("hybrid", "bucket-11", "bucket-11, angle=hybrid") for a device.

    behavior: whose device it is. The keys name the part of the device that each of several policies holds; a single
    policy's is "". Names that the device does not have are ignored, see `check_names`. Raises ConfigError.
    """
    mix = read_mix(name)
    main = mix.others.get(behavior, mix.main)

    def chosen(part: str) -> str:
        return mix.others.get(f"{behavior}.{part}", mix.others.get(part, main))

    of_axes, of_branches = ([chosen(part.name) for part in parts] for parts in (device.axes, device.branches))
    kinds = list(dict.fromkeys([*of_axes, *of_branches]))
    if len(kinds) == 1:
        return find_layouts(kinds[0], device)
    pieces = []
    for kind in kinds:
        axes = [index for index, other in enumerate(of_axes) if other == kind]
        branches = [index for index, other in enumerate(of_branches) if other == kind]
        piece = pb.Device(axes=[device.axes[i] for i in axes], branches=[device.branches[i] for i in branches])
        made = find_layouts(kind, piece)
        if list(made) != [""]:
            raise ConfigError(f"layout: {kind!r} has several policies, so it cannot be mixed with others in {name!r}")
        pieces.append(
            Layout(
                tuple(relocate(part, axes, branches) for part in made[""].continuous),
                tuple(relocate(part, axes, branches) for part in made[""].discrete),
            )
        )
    return {"": together(*pieces)}


def check_names(name: str, spec: pb.GameSpec) -> None:
    """Raise ConfigError unless all that a name of layouts is about is in a game."""
    known = [behavior.name for behavior in spec.behaviors]
    for behavior in spec.behaviors:
        device = behavior.device
        parts = [*(axis.name for axis in device.axes), *(branch.name for branch in device.branches)]
        known += [*parts, *(f"{behavior.name}.{part}" for part in parts)]
    for part in read_mix(name).others:
        if part not in known:
            expected = ", ".join(dict.fromkeys(known))
            raise ConfigError(f"layout: {name!r} is about {part!r}, which {spec.name} lacks; it has {expected}")
