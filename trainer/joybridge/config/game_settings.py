"""Options and parameters of a game: read from a command line, and compared with what the game has. No pydantic."""

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, TypeAlias

from joybridge.config.errors import ConfigError
from joybridge.contract.distributions import choose_distributions
from joybridge.contract.spec import SpecError
from joybridge.v1 import bridge_pb2 as pb

KINDS = ("uniform", "log_uniform", "choice")  # of distributions, as in bridge.proto

Value: TypeAlias = float | Mapping[str, Sequence[float]]  # of a parameter: one, or {kind of distribution: numbers}


class GameSettings(NamedTuple):
    """What of a game differs from its defaults."""

    options: dict[str, str]
    parameters: dict[str, float]


def read_settings(overrides: Sequence[str]) -> GameSettings:
    """Return what "options.NAME=CHOICE" and "parameters.NAME=VALUE" set. Raises ConfigError."""
    settings = GameSettings({}, {})
    for override in overrides:
        key, _, text = override.partition("=")
        kind, _, name = key.partition(".")
        if kind not in settings._fields or not name or not text:
            raise ConfigError(
                f"{key} cannot be set here; what can is written options.NAME=CHOICE and parameters.NAME=VALUE"
            )
        if kind == "options":
            settings.options[name] = text
            continue
        try:
            settings.parameters[name] = float(text)
        except ValueError:
            raise ConfigError(
                f"{key}: got {text!r}, expected a number; if it is an option of the game, write options.{name}={text}"
            ) from None
    return settings


def fixed(parameters: Mapping[str, Value]) -> dict[str, float]:
    """Return the parameters that have one value."""
    return {name: value for name, value in parameters.items() if not isinstance(value, Mapping)}


def drawn(parameters: Mapping[str, Value]) -> dict[str, pb.Distribution]:
    """Return the parameters that are drawn at each episode, as messages."""
    return {name: distribution_of(value) for name, value in parameters.items() if isinstance(value, Mapping)}


def read_value(value: object, *, texts: bool = True) -> Value:
    """Return a number as float, and a distribution as {kind: numbers}. Raises ValueError for anything else.

    texts: a number may be written as text, as in YAML.
    """
    if not isinstance(value, Mapping):
        return _number(value, texts)
    (kind, numbers), *others = value.items() or [(None, None)]
    if others or kind not in KINDS or not isinstance(numbers, Sequence) or isinstance(numbers, str):
        raise ValueError(
            "expected a number, {uniform: [LOW, HIGH]}, {log_uniform: [LOW, HIGH]} or {choice: [VALUE, …]}"
        )
    if kind != "choice" and len(numbers) != 2:
        raise ValueError(f"expected two numbers, {{{kind}: [LOW, HIGH]}}")
    return {kind: [_number(number, texts) for number in numbers]}


def _number(value: Any, texts: bool) -> float:
    try:
        number = math.nan if isinstance(value, bool) or (isinstance(value, str) and not texts) else float(value)
    except (TypeError, ValueError, OverflowError):
        number = math.nan
    if not math.isfinite(number):
        raise ValueError("expected a number, or a distribution such as {uniform: [LOW, HIGH]}")
    return number


def check_value(name: str, value: object) -> None:
    """Raise ConfigError for what Python code has given as a parameter and is neither a number nor a distribution."""
    try:
        read_value(value, texts=False)
    except ValueError:
        raise ConfigError(
            f"parameters.{name} is {value!r}, expected a number, {{'uniform': [LOW, HIGH]}}, "
            "{'log_uniform': [LOW, HIGH]} or {'choice': [VALUE, …]}"
        ) from None


def distribution_of(value: Value) -> pb.Distribution:
    """Return a distribution as a message; that of a number is the choice of it alone."""
    if not isinstance(value, Mapping):
        return pb.Distribution(choice=pb.Values(values=[value]))
    ((kind, numbers),) = value.items()
    if kind == "choice":
        return pb.Distribution(choice=pb.Values(values=numbers))
    low, high = numbers
    interval = pb.Interval(low=low, high=high)
    return pb.Distribution(uniform=interval) if kind == "uniform" else pb.Distribution(log_uniform=interval)


def value_text(value: Value) -> str:
    """Return a value as it is written in a configuration."""
    if not isinstance(value, Mapping):
        return f"{value:g}"
    return ", ".join(f"{{{kind}: [{', '.join(f'{n:g}' for n in numbers)}]}}" for kind, numbers in value.items())


def check_drawn(parameters: Mapping[str, pb.Distribution], spec: pb.GameSpec, where: str = "parameters") -> None:
    """Raise ConfigError for a distribution that the game cannot draw from. where: the key that they are under."""
    for name, distribution in parameters.items():
        try:
            choose_distributions(spec, {name: distribution})
        except SpecError as error:
            raise ConfigError(f"{where}.{name}: {error}") from error


def check_settings(options: Mapping[str, str], parameters: Mapping[str, Value], spec: pb.GameSpec) -> None:
    """Raise ConfigError for an option that is a parameter of the game, the reverse, or a parameter out of range."""
    known_options, known_parameters = ({thing.name for thing in things} for things in (spec.options, spec.parameters))
    for name in options.keys() & (known_parameters - known_options):
        raise ConfigError(f"options.{name}: it is a parameter of {spec.name}; write parameters.{name}=VALUE")
    for name in parameters.keys() & (known_options - known_parameters):
        raise ConfigError(f"parameters.{name}: it is an option of {spec.name}; write options.{name}=CHOICE")
    check_drawn(drawn(parameters), spec)
    values = fixed(parameters)
    for parameter in spec.parameters:
        value = values.get(parameter.name, parameter.default_value)
        if not parameter.low <= value <= parameter.high:
            raise ConfigError(
                f"parameters.{parameter.name}: got {value:g}, expected {parameter.low:g}..{parameter.high:g}"
            )
