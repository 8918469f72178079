"""The options under which a run is evaluated."""

from joybridge.config.config import Config
from joybridge.config.errors import ConfigError
from joybridge.v1 import bridge_pb2 as pb


def balanced_options(config: Config, spec: pb.GameSpec) -> dict[str, dict[str, str]]:
    """Return the options to evaluate under, equally often, by the choice of the option `stratify_by`.

    Every choice of it but its default is evaluated. Without `stratify_by`, or if `options` sets that option, there is
    one entry, "". Raises ConfigError for an option that the game does not have, or one with no choice but its default.
    """
    name = config.stratify_by
    if name is None or name in config.options:
        return {"": config.options}
    option = next((option for option in spec.options if option.name == name), None)
    if option is None:
        raise ConfigError(f"stratify_by: {spec.name} has no option {name!r}")
    choices = [choice for choice in option.choices if choice != option.default_choice]
    if not choices:
        raise ConfigError(f"stratify_by: option {name!r} of {spec.name} has no choice but its default")
    return {choice: config.options | {name: choice} for choice in choices}
