"""The checks of specs, options and parameters against the bounds in bridge.proto."""

from collections.abc import Iterable, Mapping, Sequence
from math import isfinite, isnan
from typing import Protocol

from joybridge.contract.codec import lane_count
from joybridge.contract.errors import MessageError
from joybridge.contract.limits import (
    MAX_CHOICES,
    MAX_DESCRIPTION,
    MAX_ELEMENTS,
    MAX_ENTRIES,
    MAX_FLOAT32,
    MAX_KEY,
    MAX_LANES,
    MAX_NAME,
    MAX_PER_ELEMENT,
    MAX_PIXELS,
    MAX_SIZES,
    MAX_SPEC_BYTES,
    element_count,
)
from joybridge.contract.tensors import NUMPY_TYPES
from joybridge.contract.text import printable
from joybridge.v1 import bridge_pb2 as pb

__all__ = ["SpecError", "check_spec", "choose_options", "choose_parameters"]


IMAGE_SHAPES = {pb.COLOR_GRAY: "[height, width] or [height, width, 1]", pb.COLOR_RGB: "[height, width, 3]"}


class SpecError(MessageError):
    """A spec, option or parameter breaks the contract. The text names it and what was expected."""


class _Named(Protocol):
    @property
    def name(self) -> str: ...
    @property
    def description(self) -> str: ...


def choose_options(options: Sequence[pb.Option], chosen: Mapping[str, str], game: str) -> dict[str, str]:
    """Return a choice for every option, defaults filled in. Raises SpecError for an unknown name or choice."""
    known = {option.name: option for option in options}
    for name, choice in chosen.items():
        field = f"options[{name}]"
        if name not in known:
            text = f"{game}: unknown option {name!r}, expected one of {_list(known)}"
            raise SpecError(text, pb.REASON_UNKNOWN_OPTION, field)
        if choice not in known[name].choices:
            text = f"{game}: option {name!r} got {choice!r}, expected one of {_list(known[name].choices)}"
            raise SpecError(text, pb.REASON_UNKNOWN_CHOICE, field)
    return {name: chosen.get(name, option.default_choice) for name, option in known.items()}


def choose_parameters(
    parameters: Sequence[pb.Parameter], chosen: Mapping[str, float], game: str, field: str = "parameters"
) -> dict[str, float]:
    """Return the given parameters, checked. Raises SpecError for an unknown name or a value out of range.

    field: of the message that gives them.
    """
    known = {parameter.name: parameter for parameter in parameters}
    for name, value in chosen.items():
        path = f"{field}[{name}]"
        if name not in known:
            text = f"{game}: unknown parameter {name!r}, expected one of {_list(known)}"
            raise SpecError(text, pb.REASON_UNKNOWN_PARAMETER, path)
        low, high = known[name].low, known[name].high
        if not low <= value <= high:
            text = f"{game}: parameter {name!r} got {value:g}, expected {low:g}..{high:g}"
            raise SpecError(text, pb.REASON_PARAMETER_OUT_OF_RANGE, path)
    return dict(chosen)


def check_spec(spec: pb.GameSpec) -> None:
    """Raise SpecError for the first rule of bridge.proto that `spec` breaks."""
    game = printable(spec.name)[:MAX_NAME] or "a game without a name"
    size = spec.ByteSize()
    _require(size <= MAX_SPEC_BYTES, f"{game}: the spec has {size} bytes, expected at most {MAX_SPEC_BYTES}")
    _require(bool(spec.name), f"{game}: name is empty")
    _check_text(spec.name, MAX_NAME, f"{game}: name")
    _check_text(spec.description, MAX_DESCRIPTION, f"{game}: description")
    _check_text(spec.version, MAX_NAME, f"{game}: version")
    _require(spec.decision_interval >= 1, f"{game}: decision_interval is 0, expected at least 1")
    _require(spec.max_arenas >= 1, f"{game}: max_arenas is 0, expected at least 1")
    ok = isfinite(spec.tick_seconds) and spec.tick_seconds >= 0
    _require(ok, f"{game}: tick_seconds is {spec.tick_seconds:g}, expected a finite number, at least 0")
    if spec.HasField("picture"):
        width, height = spec.picture.width, spec.picture.height
        ok = 1 <= width <= MAX_PIXELS and 1 <= height <= MAX_PIXELS
        _require(ok, f"{game}: picture is {width}x{height}, expected 1 to {MAX_PIXELS} pixels each")
    _check_names(spec.options, f"{game}: options")
    for option in spec.options:
        _check_labels(option.choices, 1, MAX_ENTRIES, f"{game}: option {option.name!r}")
        ok = option.default_choice in option.choices
        _require(ok, f"{game}: option {option.name!r} has default {option.default_choice!r}, not one of its choices")
    _check_names(spec.parameters, f"{game}: parameters")
    for parameter in spec.parameters:
        ok = parameter.low <= parameter.default_value <= parameter.high
        bounds = f"{parameter.default_value:g} outside {parameter.low:g}..{parameter.high:g}"
        _require(ok, f"{game}: parameter {parameter.name!r} has its default outside low..high: {bounds}")
        ok = isfinite(parameter.low) and isfinite(parameter.high)
        _require(ok, f"{game}: parameter {parameter.name!r} has no finite low and high")
        ok = not spec.parameters_per_episode or max(-parameter.low, parameter.high) <= MAX_FLOAT32
        _require(ok, f"{game}: parameter {parameter.name!r} may be too large for parameters_per_episode")
    _require(len(spec.behaviors) >= 1, f"{game}: no behaviors, expected at least one")
    _check_names(spec.behaviors, f"{game}: behaviors")
    for behavior in spec.behaviors:
        _check_behavior(behavior, f"{game}.{behavior.name}")
        lanes = lane_count(behavior, spec.max_arenas)
        _require(lanes <= MAX_LANES, f"{game}.{behavior.name}: {lanes} lanes in max_arenas, expected 2^31 - 1 at most")


def _check_behavior(behavior: pb.Behavior, where: str) -> None:
    device = behavior.device
    _require(behavior.agents_per_arena >= 1, f"{where}: agents_per_arena is 0, expected at least 1")
    _require(len(behavior.sensors) >= 1, f"{where}: no sensors, expected at least one")
    _require(len(behavior.channels) >= 1, f"{where}: no reward channels, expected at least one")
    _require(len(device.axes) + len(device.branches) >= 1, f"{where}: a device needs an axis or a branch")
    for things, kind in (
        (behavior.sensors, "sensors"),
        (device.axes, "axes"),
        (device.branches, "branches"),
        (behavior.channels, "channels"),
        (behavior.metrics, "metrics"),
        (behavior.scripts, "scripts"),
    ):
        _check_names(things, f"{where}: {kind}")
    for axis in device.axes:
        _require(isfinite(axis.low) and isfinite(axis.high), f"{where}: axis {axis.name!r} has no finite low and high")
        _require(axis.low < axis.high, f"{where}: axis {axis.name!r} has low {axis.low:g} not below high {axis.high:g}")
        if axis.HasField("only_with"):
            _check_condition(axis.only_with, device.branches, f"{where}: axis {axis.name!r}")
    for branch in device.branches:
        _require(len(branch.choices) >= 2, f"{where}: branch {branch.name!r} needs at least two choices")
        _check_labels(branch.choices, 2, MAX_CHOICES, f"{where}: branch {branch.name!r}")
        _check_keys(branch, f"{where}: branch {branch.name!r}")
    for channel in behavior.channels:
        ok = isfinite(channel.default_weight)
        _require(ok, f"{where}: channel {channel.name!r} has weight {channel.default_weight}, expected a finite number")
    for sensor in behavior.sensors:  # before anything multiplies them: the product may have very many digits
        sizes = len(sensor.shape)
        _require(sizes <= MAX_SIZES, f"{where}: sensor {sensor.name!r} has {sizes} sizes, expected at most {MAX_SIZES}")
    total = sum(map(element_count, behavior.sensors))
    _require(total <= MAX_ELEMENTS, f"{where}: sensors have {total} elements together, expected {MAX_ELEMENTS} at most")
    for sensor in behavior.sensors:
        what = f"{where}: sensor {sensor.name!r}"
        size = element_count(sensor)
        _require(sensor.dtype in NUMPY_TYPES, f"{what} has no valid dtype")
        _require(size >= 1 and len(sensor.shape) >= 1, f"{what} has shape {list(sensor.shape)}, expected sizes >= 1")
        _require(len(sensor.elements) in (0, size), f"{what} names {len(sensor.elements)} elements of {size}")
        longest = max(len(sensor.elements), len(sensor.low), len(sensor.high))
        _require(
            longest <= MAX_PER_ELEMENT,
            f"{what} has a list of {longest} entries, expected at most {MAX_PER_ELEMENT}; give one bound for all",
        )
        for element in sensor.elements:
            _require(bool(element), f"{what} has an empty name of an element")
            _check_text(element, MAX_NAME, f"{what}: element")
        for bounds in (sensor.low, sensor.high):
            _require(len(bounds) in (0, 1, size), f"{what} has {len(bounds)} bounds, expected 0, 1 or {size}")
            _require(not any(map(isnan, bounds)), f"{what} has a bound that is NaN")
        most = max(len(sensor.low), len(sensor.high))
        lows, highs = (list(b) * (most if len(b) == 1 else 1) for b in (sensor.low, sensor.high))
        ok = not (lows and highs) or all(low <= high for low, high in zip(lows, highs, strict=True))
        _require(ok, f"{what} has a low above its high")
        if sensor.HasField("image"):
            _check_image(sensor, what)


def _check_keys(branch: pb.Branch, what: str) -> None:
    count, named = len(branch.keys), [key for key in branch.keys if key]
    _require(count in (0, len(branch.choices)), f"{what} has {count} keys for {len(branch.choices)} choices")
    _require(len(set(named)) == len(named), f"{what} has one key for two choices")
    for key in named:
        ok = len(key) <= MAX_KEY and key.isascii() and key.isalnum()
        _require(ok, f"{what} has the key {key[:MAX_KEY]!r}, expected 1 to {MAX_KEY} letters and digits, such as KeyE")


def _check_condition(condition: pb.Condition, branches: Iterable[pb.Branch], what: str) -> None:
    choices = {branch.name: branch.choices for branch in branches}
    known = condition.branch in choices
    _require(known, f"{what} counts only with branch {condition.branch!r}, expected one of {_list(choices)}")
    labels = choices[condition.branch]
    known = condition.choice in labels
    _require(known, f"{what} counts only with choice {condition.choice!r}, expected one of {_list(labels)}")


def _check_image(sensor: pb.Sensor, what: str) -> None:
    shape = list(sensor.shape)
    _require(sensor.dtype == pb.DTYPE_UINT8, f"{what} is an image of another dtype than UINT8")
    _require(sensor.image.color in IMAGE_SHAPES, f"{what} is an image without a valid color")
    wanted = IMAGE_SHAPES[sensor.image.color]
    fits = len(shape) == 3 and shape[2] == (3 if sensor.image.color == pb.COLOR_RGB else 1)
    fits = fits or (len(shape) == 2 and sensor.image.color == pb.COLOR_GRAY)
    _require(fits, f"{what} is an image of shape {shape}, expected {wanted}")


def _check_names(things: Sequence[_Named], where: str) -> None:
    names = [thing.name for thing in things]
    _require(len(names) <= MAX_ENTRIES, f"{where}: {len(names)} entries, expected at most {MAX_ENTRIES}")
    _require(all(names), f"{where}: a name is empty")
    for thing in things:
        _check_text(thing.name, MAX_NAME, f"{where}: name")
        _check_text(thing.description, MAX_DESCRIPTION, f"{where}: description of {thing.name!r}")
    _require(len(set(names)) == len(names), f"{where}: a name stands twice in {names}")


def _check_labels(labels: Sequence[str], fewest: int, most: int, where: str) -> None:
    _require(fewest <= len(labels) <= most, f"{where} has {len(labels)} choices, expected {fewest} to {most}")
    _require(len(set(labels)) == len(labels), f"{where} repeats a choice")
    _require(all(labels), f"{where} has an empty choice")
    for label in labels:
        _check_text(label, MAX_NAME, f"{where}: choice")


def _check_text(text: str, most: int, where: str) -> None:
    _require(len(text) <= most, f"{where} has {len(text)} characters, expected at most {most}")
    _require(text.isprintable(), f"{where} is {text!r}, expected printable characters only")


def _require(condition: bool, message: str) -> None:
    if not condition:
        raise SpecError(message)


def _list(names: Iterable[str]) -> str:
    return ", ".join(names) or "none"
