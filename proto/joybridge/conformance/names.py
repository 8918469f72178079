"""Names in lists of a spec."""

from collections.abc import Iterable

from joybridge.conformance.expectations import expect


def names_of(items: Iterable[object]) -> list[str]:
    """Return the names of some messages."""
    return [str(getattr(item, "name", "")) for item in items]


def expect_unique_names(items: Iterable[object], what: str) -> None:
    """Raise Violation unless every name is unique and not empty."""
    names = names_of(items)
    expect(all(names) and len(set(names)) == len(names), f"{what} {names}", "unique names that are not empty")
