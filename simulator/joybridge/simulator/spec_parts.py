"""Functions that build a game's spec: `spec` and, for each part of one, a function of the same name.

A spec is a protobuf message, defined and documented in bridge.proto. With these functions, authors do not write
protobuf themselves.
"""

from collections.abc import Mapping, Sequence
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from joybridge.contract.tensors import NUMPY_TYPES
from joybridge.simulator.batched_game import BatchedGame
from joybridge.simulator.game import Game
from joybridge.v1 import bridge_pb2 as pb

AXIS_KINDS = {
    "position": pb.AXIS_KIND_POSITION,
    "velocity": pb.AXIS_KIND_VELOCITY,
    "angle": pb.AXIS_KIND_ANGLE,
}
AXIS_WAYS = {"right": pb.WAY_RIGHT, "left": pb.WAY_LEFT, "up": pb.WAY_UP, "down": pb.WAY_DOWN}
CODES = {
    "space": "Space",
    "enter": "Enter",
    "tab": "Tab",
    "shift": "ShiftLeft",
    "ctrl": "ControlLeft",
    "alt": "AltLeft",
    "left": "ArrowLeft",
    "right": "ArrowRight",
    "up": "ArrowUp",
    "down": "ArrowDown",
    "mouse left": "Mouse0",
    "mouse middle": "Mouse1",
    "mouse right": "Mouse2",
}
T = TypeVar("T")


def spec(
    game: type[Game] | type[BatchedGame],
    behaviors: Sequence[pb.Behavior],
    *,
    parameters: Sequence[pb.Parameter] = (),
    decision_interval: int = 1,
    tick_seconds: float = 0.0,
    max_episode_decisions: int = 0,
    max_arenas: int = 1024,
    picture: tuple[int, int] | None = None,
    snapshot_bytes_per_arena: int = 0,
    parameters_per_episode: bool = False,
) -> pb.GameSpec:
    """Return the spec of a game; its name, description, options and version come from the class.

    parameters: what `Game.parameter` holds.
    decision_interval: ticks per decision.
    tick_seconds: game time of a tick; 0 for a game without a clock. Videos are played at this speed.
    max_episode_decisions: the length at which episodes are truncated; 0 if they are not.
    max_arenas: the most arenas that one session may run.
    picture: (width, height) of what `draw` returns; None if the game cannot be drawn.
    snapshot_bytes_per_arena: an upper bound of what `BatchedGame.save` returns; 0 if the game has no snapshots.
    parameters_per_episode: whether a BatchedGame obeys `distributions`. Those of every Game are drawn by the server.
    """
    return pb.GameSpec(
        name=game.name,
        description=game.description,
        options=game.options,
        parameters=parameters,
        behaviors=behaviors,
        decision_interval=decision_interval,
        tick_seconds=tick_seconds,
        max_episode_decisions=max_episode_decisions,
        max_arenas=max_arenas,
        picture=pb.PictureSize(width=picture[0], height=picture[1]) if picture else None,
        snapshot_bytes_per_arena=snapshot_bytes_per_arena,
        parameters_per_episode=parameters_per_episode,
        version=game.version,
    )


def option(name: str, choices: Sequence[str], default: str | None = None, description: str = "") -> pb.Option:
    """Return an option: a choice that is made once per session and may change the spec. Default: the first choice."""
    default_choice = choices[0] if default is None else default
    return pb.Option(name=name, description=description, choices=choices, default_choice=default_choice)


def parameter(name: str, low: float, high: float, default: float, description: str = "") -> pb.Parameter:
    """Return a parameter: a number in low..high that may change whenever an episode begins."""
    return pb.Parameter(name=name, description=description, low=low, high=high, default_value=default)


def behavior(
    name: str,
    *,
    sensors: Sequence[pb.Sensor],
    axes: Sequence[pb.Axis] = (),
    branches: Sequence[pb.Branch] = (),
    channels: Sequence[pb.RewardChannel] = (),
    metrics: Sequence[str | pb.Metric] = (),
    scripts: Mapping[str, str] | None = None,
    agents: int = 1,
    description: str = "",
) -> pb.Behavior:
    """Return a kind of agent: what it observes, its actions, its rewards, and how many there are per arena.

    An agent uses all axes and branches at the same time; it needs at least one of them. Without channels it has a
    single one named "reward". scripts: players of yours that may play an agent, each with a description; see
    `Game.script`. A BatchedGame obeys `ActArrays.scripts`.
    """
    return pb.Behavior(
        name=name,
        description=description,
        agents_per_arena=agents,
        sensors=sensors,
        device=pb.Device(axes=axes, branches=branches),
        channels=channels or [channel("reward")],
        metrics=[metric(one) if isinstance(one, str) else one for one in metrics],
        scripts=[pb.Script(name=name, description=text) for name, text in (scripts or {}).items()],
    )


def sensor(
    name: str,
    shape: Sequence[int],
    low: npt.ArrayLike | None = None,
    high: npt.ArrayLike | None = None,
    description: str = "",
    *,
    dtype: npt.DTypeLike = "float32",
    elements: Sequence[str] = (),
) -> pb.Sensor:
    """Return a sensor: one named array of an observation.

    shape: of one agent's array, as [64, 64, 3] for an image.
    low, high: the smallest and largest value, one for all elements or an array of `shape`; None if unbounded.
    dtype: float32, int32, uint8 or bool. Raises ValueError for another.
    elements: a label per element, row-major.
    """
    wire_types = {numpy_type: wire for wire, numpy_type in NUMPY_TYPES.items()}
    wire_type = wire_types.get(np.dtype(dtype).newbyteorder("<"))
    if wire_type is None:
        wanted = ", ".join(str(known) for known in wire_types)
        raise ValueError(f"sensor {name!r} has dtype {np.dtype(dtype)}, expected one of {wanted}")
    return pb.Sensor(
        name=name,
        description=description,
        dtype=wire_type,
        shape=shape,
        elements=elements,
        low=[] if low is None else np.ravel(low).tolist(),
        high=[] if high is None else np.ravel(high).tolist(),
    )


def image(
    name: str, height: int, width: int, description: str = "", *, channels: int = 1, centered: bool = False
) -> pb.Sensor:
    """Return a sensor that is an image, uint8 [height, width, channels].

    channels: 1 for gray, 3 for RGB. Raises ValueError for another number.
    centered: whether its middle is always where the agent's pointer is.
    """
    colors = {1: pb.COLOR_GRAY, 3: pb.COLOR_RGB}
    if channels not in colors:
        raise ValueError(f"image {name!r} has {channels} channels, expected 1 for gray or 3 for RGB")
    made = sensor(name, [height, width, channels], 0, 255, description, dtype="uint8")
    made.image.CopyFrom(pb.Image(color=colors[channels], centered=centered))
    return made


def axis(
    name: str,
    low: float = -1.0,
    high: float = 1.0,
    description: str = "",
    *,
    only_with: tuple[str, str] | None = None,
    kind: str = "",
    way: str = "",
) -> pb.Axis:
    """Return an axis: a continuous action in low..high.

    only_with: a branch and one of its choices: the game ignores the axis in decisions with another choice.
    kind: position (it puts something at a place), velocity (it moves something) or angle (it turns something to a
    direction); "": not said.
    way: right, left, up or down: where the largest value points in the picture; "": not said. Pygame and other canvases
    count y from the top, so the y of a mouse there has the way down. Raises ValueError for another kind or way.
    """
    condition = pb.Condition(branch=only_with[0], choice=only_with[1]) if only_with else None
    made = pb.Axis(name=name, description=description, low=low, high=high, only_with=condition)
    if kind:
        made.kind = _known(f"axis {name!r} has kind", kind, AXIS_KINDS)
    if way:
        made.way = _known(f"axis {name!r} has way", way, AXIS_WAYS)
    return made


def branch(name: str, choices: Sequence[str], description: str = "", *, keys: Sequence[str] = ()) -> pb.Branch:
    """Return a branch: a discrete action with two or more labeled choices.

    keys: with which a person selects each choice, "" for none: a letter, a digit, a name such as "space", "enter",
    "left" or "mouse right", or a `code` of browsers such as "Backquote"; none: the page of `play` proposes some.
    """
    return pb.Branch(name=name, description=description, choices=choices, keys=[_code(key) for key in keys])


def button(name: str, description: str = "", *, key: str = "") -> pb.Branch:
    """Return a branch with two choices: 0 released, 1 pressed. key: with which a person presses it, see `branch`."""
    return branch(name, ["released", "pressed"], description, keys=("", key) if key else ())


def _code(key: str) -> str:
    """Return the code of a key, as browsers call it."""
    if len(key) == 1 and key.isascii() and key.isalnum():
        return f"Digit{key}" if key.isdigit() else f"Key{key.upper()}"
    return CODES.get(key.lower(), key)


def _known(what: str, given: str, known: Mapping[str, T]) -> T:
    if given not in known:
        raise ValueError(f"{what} {given!r}, expected one of {', '.join(known)}")
    return known[given]


def channel(name: str, default_weight: float = 1.0, description: str = "") -> pb.RewardChannel:
    """Return a reward channel: one part of the reward. An agent's reward is the weighted sum of its channels."""
    return pb.RewardChannel(name=name, description=description, default_weight=default_weight)


def metric(name: str, description: str = "") -> pb.Metric:
    """Return a metric: a number about an episode, reported at its end."""
    return pb.Metric(name=name, description=description)
