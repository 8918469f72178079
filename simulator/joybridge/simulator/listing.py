"""The output of `joybridge list`: what every spec says about a game, its options and its agents."""

from collections.abc import Iterable, Iterator
from textwrap import wrap

from joybridge.contract.tensors import NUMPY_TYPES
from joybridge.simulator.spec_parts import AXIS_KINDS, AXIS_WAYS
from joybridge.v1 import bridge_pb2 as pb

WIDTH = 120  # columns
KINDS = {number: name for name, number in AXIS_KINDS.items()}
WAYS = {way: f"to the {name}" if name in ("left", "right") else name for name, way in AXIS_WAYS.items()}


def listing(games: Iterable[pb.GameSpec]) -> str:
    """Return a paragraph of text per game."""
    return "\n\n".join("\n".join(_game(spec)) for spec in games)


def _game(spec: pb.GameSpec) -> Iterator[str]:
    yield f"{spec.name}: {spec.description}"
    yield from _line(2, "version", spec.version)
    yield from _line(2, "time", ", ".join(_time(spec)))
    for option in spec.options:
        yield from _line(2, f"option {option.name}", f"{' | '.join(option.choices)} (default {option.default_choice})")
    for parameter in spec.parameters:
        bounds = f"{parameter.low:g} .. {parameter.high:g} (default {parameter.default_value:g})"
        yield from _line(2, f"parameter {parameter.name}", bounds)
    for behavior in spec.behaviors:
        agents = (
            f"{behavior.agents_per_arena} agents per arena" if behavior.agents_per_arena > 1 else "1 agent per arena"
        )
        yield from _line(2, f"behavior {behavior.name}", agents)
        yield from _line(4, "sensors", ", ".join(map(_sensor, behavior.sensors)))
        yield from _line(4, "axes", ", ".join(map(_axis, behavior.device.axes)))
        yield from _line(4, "branches", ", ".join(map(_branch, behavior.device.branches)))
        channels = (f"{channel.name} (weight {channel.default_weight:g})" for channel in behavior.channels)
        yield from _line(4, "rewards", ", ".join(channels))
        yield from _line(4, "metrics", ", ".join(metric.name for metric in behavior.metrics))
        yield from _line(4, "scripts", ", ".join(script.name for script in behavior.scripts))


def _time(spec: pb.GameSpec) -> Iterator[str]:
    if spec.tick_seconds:
        ticks = f" ({spec.decision_interval} ticks)" if spec.decision_interval > 1 else ""
        yield f"a decision every {1000 * spec.tick_seconds * spec.decision_interval:.4g} ms{ticks}"
    if spec.max_episode_decisions:
        yield f"episodes of at most {spec.max_episode_decisions:,} decisions"


def _sensor(sensor: pb.Sensor) -> str:
    dtype = NUMPY_TYPES[sensor.dtype].name
    if sensor.HasField("image"):
        color = "RGB" if sensor.image.color == pb.COLOR_RGB else "gray"
        return f"{sensor.name} {list(sensor.shape)} {color}" + (", centered" if sensor.image.centered else "")
    return f"{sensor.name} {list(sensor.shape)}" + (f" {dtype}" if sensor.dtype != pb.DTYPE_FLOAT32 else "")


def _axis(axis: pb.Axis) -> str:
    condition = f" (with {axis.only_with.branch} {axis.only_with.choice})" if axis.HasField("only_with") else ""
    said = [name for name in (KINDS.get(axis.kind), WAYS.get(axis.way)) if name]
    return f"{axis.name} {axis.low:g}..{axis.high:g}{condition}" + (f" ({', '.join(said)})" if said else "")


def _branch(branch: pb.Branch) -> str:
    keys = branch.keys or [""] * len(branch.choices)
    labels = [f"{label} [{key}]" if key else label for label, key in zip(branch.choices, keys, strict=True)]
    few = len(labels) <= 8
    return f"{branch.name} ({' | '.join(labels) if few else f'{len(branch.choices)} choices'})"


def _line(indent: int, label: str, text: str) -> Iterator[str]:
    """Yield "label: text", wrapped; nothing for an empty text."""
    if text:
        start = " " * indent
        yield from wrap(f"{label}: {text}", WIDTH, initial_indent=start, subsequent_indent=start + "    ")
