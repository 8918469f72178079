"""The checks: one module per family."""

from joybridge.conformance.registry import Check, checks_of
from joybridge.conformance.rules import (
    action_tensors,
    actions,
    behaviors,
    episode_ends,
    games,
    health_and_reflection,
    limits,
    order,
    pictures,
    resets,
    seeds,
    sessions,
    settings,
    snapshots,
    specs,
    start,
    steps,
    versions,
)

_MODULES = (
    health_and_reflection, versions, games, specs, behaviors, start, settings, order, actions, action_tensors, seeds,
    resets, steps, episode_ends, pictures, snapshots, sessions, limits,
)  # fmt: skip
FAMILIES: dict[str, str] = {  # name -> description, in the order in which they run
    module.__name__.rpartition(".")[2]: (module.__doc__ or "").partition("\n")[0] for module in _MODULES
}
CHECKS: list[Check] = [check for family in FAMILIES for check in checks_of(family)]
