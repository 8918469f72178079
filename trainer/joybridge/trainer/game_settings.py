"""Options and parameters of a game: read from a command line, and compared with what the game has. No pydantic."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from joybridge.trainer.errors import ConfigError
from joybridge.v1 import bridge_pb2 as pb


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


def check_settings(options: Mapping[str, str], parameters: Mapping[str, float], spec: pb.GameSpec) -> None:
    """Raise ConfigError for an option that is a parameter of the game, the reverse, or a parameter out of range."""
    known_options, known_parameters = ({thing.name for thing in things} for things in (spec.options, spec.parameters))
    for name in options.keys() & (known_parameters - known_options):
        raise ConfigError(f"options.{name}: it is a parameter of {spec.name}; write parameters.{name}=VALUE")
    for name in parameters.keys() & (known_options - known_parameters):
        raise ConfigError(f"parameters.{name}: it is an option of {spec.name}; write options.{name}=CHOICE")
    for parameter in spec.parameters:
        value = parameters.get(parameter.name, parameter.default_value)
        if not parameter.low <= value <= parameter.high:
            raise ConfigError(
                f"parameters.{parameter.name}: got {value:g}, expected {parameter.low:g}..{parameter.high:g}"
            )
