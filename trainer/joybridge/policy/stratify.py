"""The options under which a run is evaluated."""

from joybridge.config.config import Config
from joybridge.config.errors import ConfigError
from joybridge.v1 import bridge_pb2 as pb


def balanced_options(config: Config, spec: pb.GameSpec) -> dict[str, dict[str, str]]:
    """Return the options to evaluate under, equally often, by the choice of the option `evaluate_over`.

    Every choice of it but its default is evaluated. Without `evaluate_over`, or if `options` sets that option, there is
    one entry, "". Raises ConfigError for an option that the game does not have, or one with no choice but its default.
    """
    name = config.evaluate_over
    if name is None or name in config.options:
        return {"": config.options}
    option = next((option for option in spec.options if option.name == name), None)
    if option is None:
        raise ConfigError(f"evaluate_over: {spec.name} has no option {name!r}")
    choices = [choice for choice in option.choices if choice != option.default_choice]
    if not choices:
        raise ConfigError(f"evaluate_over: option {name!r} of {spec.name} has no choice but its default")
    return {choice: config.options | {name: choice} for choice in choices}
