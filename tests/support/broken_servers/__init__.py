"""Servers that break the contract in one way each, and a game on which every rule can be tried.

BROKEN lists them, each with exactly the checks that must fail.
"""

from tests.support.broken_servers import (
    actions,
    deployment,
    order,
    pictures,
    seeds,
    sessions,
    settings,
    specs,
    steps,
)
from tests.support.broken_servers.deployment import PROTECTED
from tests.support.broken_servers.gauntlet import DRAWS, LENGTH, LONGEST, Gauntlet
from tests.support.broken_servers.serving import BROKEN, BrokenServer, Honest, Service, serving
from tests.support.broken_servers.sessions import AnswersTwice, Leaks

__all__ = [
    "BROKEN",
    "DRAWS",
    "LENGTH",
    "LONGEST",
    "PROTECTED",
    "AnswersTwice",
    "BrokenServer",
    "Gauntlet",
    "Honest",
    "Leaks",
    "Service",
    "serving",
]

FAMILIES = (actions, deployment, order, pictures, seeds, sessions, settings, specs, steps)  # each adds to BROKEN
