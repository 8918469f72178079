"""Whether a configuration fits a game, found without torch: layout, policies, their sensors, rewards and behaviors."""

from collections.abc import Sequence

from joybridge.client.client import describe
from joybridge.config.config import Config, load_config
from joybridge.config.config_files import find_config
from joybridge.config.errors import ConfigError
from joybridge.config.game_settings import check_drawn, check_settings, distribution_of
from joybridge.config.metrics import column_name
from joybridge.config.programs import programs_of, with_names
from joybridge.layouts import Role, list_roles
from joybridge.policy.encoder import ObservationEncoder
from joybridge.policy.hand import pointer_speeds
from joybridge.policy.lineup import make_lineup
from joybridge.policy.network_fit import check_network
from joybridge.policy.scaling import make_scaling
from joybridge.policy.stratify import balanced_options
from joybridge.v1 import bridge_pb2 as pb


def find_and_load(text: str, overrides: Sequence[str] = ()) -> Config:
    """Return the configuration in a file, or the installed one of a name, with overrides. Raises ConfigError."""
    return load_config(find_config(text), [*overrides, *with_names(programs_of(text, overrides))])


def fitting_spec(address: str, config: Config) -> pb.GameSpec:
    """Return the spec of a configuration's game under its options. Raises SimulatorError and ConfigError.

    That of several games is their common spec.
    """
    if config.games:
        return make_lineup(address, config).spec
    if config.options:
        # With a wrong option there would be no spec.
        check_settings(config.options, config.parameters, describe(address, config.game, {}))
    spec = describe(address, config.game, config.options)
    check_settings(config.options, config.parameters, spec)
    check_curriculum(config, spec)
    return spec


def check_fit(config: Config, spec: pb.GameSpec) -> None:
    """Raise ConfigError unless every policy can be made for a spec."""
    check_settings(config.options, config.parameters, spec)
    check_curriculum(config, spec)
    balanced_options(config, spec)
    pointer_speeds(config, spec)
    for role in fitting_roles(config, spec):
        policy, behavior = config.policy_config(role.name), spec.behaviors[role.behavior]
        weights, images = policy.reward_weights, policy.image_encoder
        encoder = ObservationEncoder(role.name, behavior, policy.sensors, weights, images)
        make_scaling(role.name, policy.scale_observations, encoder.numbers)
        check_network(role, behavior.device, policy, encoder.images.values())


def check_curriculum(config: Config, spec: pb.GameSpec) -> None:
    """Raise ConfigError for a lesson with a parameter, a policy or a metric that the game does not have."""
    for index, lesson in enumerate(config.curriculum):
        where = f"curriculum.{index}"
        values = {name: distribution_of(value) for name, value in lesson.parameters.items()}
        check_drawn(values, spec, f"{where}.parameters")
        if lesson.until is None:
            continue
        roles = {role.name: spec.behaviors[role.behavior] for role in fitting_roles(config, spec)}
        policy = lesson.until.policy or next(iter(roles))
        if policy not in roles:
            raise ConfigError(f"{where}.until.policy: there is no policy {policy!r}; there are {', '.join(roles)}")
        metrics = [column_name(metric.name) for metric in roles[policy].metrics]
        known = ["reward", "length", *metrics, "progress"]
        if lesson.until.metric not in known:
            wrong = f"there is no metric {lesson.until.metric!r}; {policy} has {', '.join(known)}"
            raise ConfigError(f"{where}.until.metric: {wrong}")


def fitting_roles(config: Config, spec: pb.GameSpec) -> list[Role]:
    """Return the roles of all policies. Raises ConfigError for a layout or a policy that the game does not have."""
    roles = list_roles(config.layout, spec)
    names = [role.name for role in roles]
    for name in config.policies:
        if name not in names:
            raise ConfigError(f"policies: there is no policy {name!r}; this game and layout have {', '.join(names)}")
    return roles


def find_behavior(spec: pb.GameSpec, name: str, where: str) -> int:
    """Return the index of a behavior; "": the only one. where: it is named, for errors. Raises ConfigError."""
    names = [behavior.name for behavior in spec.behaviors]
    if not name and len(names) == 1:
        return 0
    if name not in names:
        problem = f"has no behavior {name!r}" if name else "has several behaviors"
        raise ConfigError(f"{spec.name} {problem}; choose one with {where}: {', '.join(names)}")
    return names.index(name)
