"""Whether an exported file can hold a policy."""

from joybridge.config.config import Config, HandConfig
from joybridge.layouts import Role
from joybridge.layouts.layout import GAUSSIAN, SQUASHED

IN_PYTHON = "play its run with `joybridge.play.agent.load`"


def export_refusal(config: Config, role: Role) -> str:
    """Return why no file can hold the policy of a run that has a role, and what to do instead; "": one can."""
    policy = config.policy_config(role.name)
    if config.pointer == "velocity":
        return (
            "with `pointer: velocity` the trainer remembers where the pointer is, and exported files do not; "
            f"{IN_PYTHON}, or train it with axes that move the pointer"
        )
    if policy.network:
        return (
            f"it has a network of its own, {policy.network}, which no exported file can hold; {IN_PYTHON}, or train "
            "without policy.network"
        )
    if policy.remember_acts:
        return (
            f"policies that see their last actions cannot be exported; {IN_PYTHON}, or train it with "
            "policy.remember_acts=0 and policy.memory"
        )
    unknown = [name for name in role.layout.space.distributions if name not in (GAUSSIAN, SQUASHED)]
    if unknown:
        names = ", ".join(dict.fromkeys(name.rpartition(":")[2] for name in unknown))
        return (
            f"axes are drawn from {names}, which cannot be exported; {IN_PYTHON}, or train it with another layout, "
            "such as squashed, hybrid or bucket-11"
        )
    defaults = dict(HandConfig())
    if limited := {key: value for key, value in config.hand if value != defaults[key]}:
        trained = " ".join(f"hand.{key}={value}" for key, value in limited.items())
        free = " ".join(f"hand.{key}={defaults[key]}" for key in limited)
        return (
            f"its hand is limited, {trained}, and exported files have none; {IN_PYTHON}, or export what it wants to "
            f"do, without its hand, by adding {free}"
        )
    return ""
