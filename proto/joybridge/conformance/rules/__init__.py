"""The checks: one module per family, in the order in which failures are to be repaired."""

from joybridge.conformance.registry import Check, checks_of
from joybridge.conformance.rules import (
    action_tensors,
    actions,
    behaviors,
    choices,
    distributions,
    episode_ends,
    games,
    health_and_reflection,
    limits,
    order,
    pictures,
    resets,
    scripts,
    security,
    seeds,
    sessions,
    settings,
    snapshots,
    specs,
    start,
    steps,
    versions,
)

_MODULES = (  # what others build on comes first: a game that is not deterministic fails checks of most families
    games, specs, behaviors, start, steps, episode_ends, seeds, sessions, versions, resets, settings, distributions,
    choices, order, actions, action_tensors, scripts, pictures, snapshots, limits, security, health_and_reflection,
)  # fmt: skip
FAMILIES: dict[str, str] = {  # name -> description, in the order in which they run and are to be repaired
    module.__name__.rpartition(".")[2]: (module.__doc__ or "").partition("\n")[0] for module in _MODULES
}
CHECKS: list[Check] = [check for family in FAMILIES for check in checks_of(family)]
