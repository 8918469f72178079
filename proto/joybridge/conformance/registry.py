"""The registry of checks. A check is a function; its docstring is the rule that it tests."""

from collections.abc import Callable
from dataclasses import dataclass

from joybridge.conformance.subject import Subject

Function = Callable[[Subject], None]


@dataclass(frozen=True)
class Check:
    """One rule of bridge.proto and the function that tests it."""

    name: str
    family: str  # the module in `rules/`
    rule: str
    section: str  # the section or message of bridge.proto that states the rule
    per_server: bool  # run once per server instead of once per game
    run: Function


_CHECKS: list[Check] = []


def check(section: str, per_server: bool = False) -> Callable[[Function], Function]:
    """Register a function as a check; `section` is where bridge.proto states its rule."""

    def register(function: Function) -> Function:
        family = function.__module__.rpartition(".")[2]
        rule = " ".join((function.__doc__ or "").split())
        _CHECKS.append(Check(function.__name__, family, rule, section, per_server, function))
        return function

    return register


def checks_of(family: str) -> list[Check]:
    """Return the checks of one family, in the order of their definition."""
    return [check for check in _CHECKS if check.family == family]
