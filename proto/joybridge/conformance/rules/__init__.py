"""The conformance kit of joybridge.v1: every rule of bridge.proto that can be seen from outside, as a check.

Each module that is imported here is a family of rules; the others are what these are written with. The kit
speaks to a server over the wire alone, so a server in any language can be held to the contract.
"""

from joybridge.conformance.registry import Check, checks_of
from joybridge.conformance.rules import (
    actions,
    companions,
    limits,
    order,
    pictures,
    seeds,
    sessions,
    settings,
    snapshots,
    specs,
    starts,
    steps,
)

FAMILIES = [
    module.__name__.rpartition(".")[2]
    for module in (
        companions, specs, starts, settings, order, actions, seeds, steps, pictures, snapshots, sessions, limits,
    )
]  # fmt: skip
CHECKS: list[Check] = [check for family in FAMILIES for check in checks_of(family)]
