"""Choosing checks and games by name."""

from collections.abc import Iterable, Sequence
from difflib import get_close_matches

from joybridge.conformance.registry import Check
from joybridge.conformance.rules import CHECKS, FAMILIES
from joybridge.contract.errors import JoybridgeError
from joybridge.contract.text import printable

MAX_NAMES = 4  # listed in an error


class SelectionError(JoybridgeError):
    """A name of a family, check or game that does not exist; the text names the nearest ones."""


def select(families: Sequence[str] = (), names: Sequence[str] = ()) -> list[Check]:
    """Return the checks of some families and those with some names, or all if neither is given.

    Raises SelectionError for an unknown family or check.
    """
    require_known(families, FAMILIES, "family")
    require_known(names, [check.name for check in CHECKS], "check")
    if not families and not names:
        return list(CHECKS)
    return [check for check in CHECKS if check.family in families or check.name in names]


def require_known(names: Iterable[str], known: Iterable[str], what: str) -> None:
    """Raise SelectionError for the first name that is not among the known ones."""
    known = list(known)
    for name in names:
        if name not in known:
            near = nearest(name, known)
            hint = f"the nearest are {', '.join(near)}" if len(near) < len(known) else f"expected {', '.join(known)}"
            raise SelectionError(f"unknown {what} {name!r}; {printable(hint)}")


def nearest(name: str, known: Sequence[str]) -> list[str]:
    """Return the names that contain `name`, or else those with the most similar spelling."""
    containing = [other for other in known if name and name.lower() in other]
    return (containing or get_close_matches(name, known, MAX_NAMES, cutoff=0.0))[:MAX_NAMES]
