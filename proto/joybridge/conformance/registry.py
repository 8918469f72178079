"""The registry of checks. A check is a function whose docstring is the rule that it tests, or a row of a table."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeAlias, TypeVar

from joybridge.conformance.subject import Subject

Function = TypeVar("Function", bound=Callable[..., None])
Rows: TypeAlias = Iterable[tuple[Any, ...]]  # of a table: the name, section and rule of a check, and what it takes


@dataclass(frozen=True)
class Check:
    """One rule of bridge.proto and the function that tests it."""

    name: str
    family: str  # the module in `rules/`
    rule: str
    section: str  # the section or message of bridge.proto that states the rule
    per_server: bool  # run once per server instead of once per game
    run: Callable[[Subject], None]


_CHECKS: list[Check] = []


def check(section: str, per_server: bool = False) -> Callable[[Function], Function]:
    """Register a function as a check; `section` is where bridge.proto states its rule."""

    def register(function: Function) -> Function:
        rule = " ".join((function.__doc__ or "").split())
        _CHECKS.append(Check(function.__name__, _family(function), rule, section, per_server, function))
        return function

    return register


def table(rows: Rows, per_server: bool = False) -> Callable[[Function], Function]:
    """Register one check per row: its name, section and rule, and what the function takes after the subject."""

    def register(function: Function) -> Function:
        for name, section, rule, *arguments in rows:
            run = partial(_run_row, function, tuple(arguments))
            _CHECKS.append(Check(name, _family(function), rule, section, per_server, run))
        return function

    return register


def checks_of(family: str) -> list[Check]:
    """Return the checks of one family, in the order of their definition."""
    return [check for check in _CHECKS if check.family == family]


def _run_row(function: Callable[..., None], arguments: tuple[Any, ...], subject: Subject) -> None:
    function(subject, *arguments)


def _family(function: Callable[..., None]) -> str:
    return function.__module__.rpartition(".")[2]
