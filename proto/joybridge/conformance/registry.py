"""What a check is: a function named as a sentence, whose docstring is the rule that it holds a server to."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from joybridge.conformance.subject import Subject

Function = Callable[["Subject"], None]


class Broken(Exception):
    """A server broke the rule of the check that raises this."""

    def __init__(self, came: object, expected: object) -> None:
        super().__init__(f"got {came}, expected {expected}")
        self.came, self.expected = str(came), str(expected)


class Silent(Broken):
    """A server let a deadline pass."""


class DoesNotApply(Exception):
    """A game lacks what a check is about; the text says what."""


@dataclass(frozen=True)
class Check:
    """One rule of bridge.proto and the function that tries a server on it."""

    name: str
    family: str
    rule: str
    manual: str  # the section or message of bridge.proto that has the rule
    once: bool  # about the server as a whole and not about each of its games
    run: Function


_CHECKS: list[Check] = []


def check(manual: str, once: bool = False) -> Callable[[Function], Function]:
    """Register a function as a check; `manual` is where in bridge.proto its rule stands."""

    def register(function: Function) -> Function:
        family = function.__module__.rpartition(".")[2]
        rule = " ".join((function.__doc__ or "").split())
        _CHECKS.append(Check(function.__name__, family, rule, manual, once, function))
        return function

    return register


def checks_of(family: str) -> list[Check]:
    """Return the checks of one family, in the order in which they are written."""
    return [check for check in _CHECKS if check.family == family]


def expect(holds: object, came: object, expected: object) -> None:
    """Raise Broken unless what was expected holds."""
    if not holds:
        raise Broken(came, expected)


def expect_equal(came: object, expected: object, what: str) -> None:
    """Raise Broken unless two things are equal."""
    expect(came == expected, f"{what} {came!r}", repr(expected))


def needs(there: object, what: str) -> None:
    """Raise DoesNotApply unless a game has what a check is about."""
    if not there:
        raise DoesNotApply(what)
