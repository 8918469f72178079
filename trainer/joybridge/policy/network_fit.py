"""Whether the settings of a network fit its layout and what it sees, found without torch."""

from collections.abc import Collection, Mapping

from joybridge.config.errors import ConfigError
from joybridge.config.policy_config import PolicyConfig
from joybridge.layouts import Role
from joybridge.ppo.images import Image, check_differences, check_maps
from joybridge.v1 import bridge_pb2 as pb


def check_network(role: Role, device: pb.Device, config: PolicyConfig, images: Collection[Image]) -> None:
    """Raise ConfigError unless a policy of this role can have the network that is configured. images: that it sees."""
    space = role.layout.space
    check_maps(role.name, [form for _, form in space.maps], images)
    if config.frame_differences:
        check_differences(role.name, config.network, config.frame_stack, images)
    if config.network and space.maps:
        raise ConfigError(f"network: {config.network} has no maps for the layout; choose one without map-WxH")
    if config.network and config.remember_acts:
        raise ConfigError(f"network: {config.network} sees sensors alone; set remember_acts to 0")
    if isinstance(config.log_std_init, Mapping):
        known = space.with_deviation(role.layout.names(device)[1])
        if unknown := [name for name in config.log_std_init if name not in known]:
            there = ", ".join(known) or "none"
            raise ConfigError(f"log_std_init: {unknown[0]!r} has no Gaussian; there are {there}")
