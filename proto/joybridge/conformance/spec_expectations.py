"""What every part of a spec must satisfy, and how the parts of one kind are found."""

from collections.abc import Callable, Iterable, Sequence
from typing import Any

from joybridge.conformance.expectations import Violation, expect, skip_unless
from joybridge.contract.spec import SpecError, check_spec
from joybridge.v1 import bridge_pb2 as pb

PATHS = {  # the parts of one kind in a spec; without a path it is the spec itself
    "spec": (),
    "options": ("options",),
    "parameters": ("parameters",),
    "pictures": ("picture",),
    "behaviors": ("behaviors",),
    "sensors": ("behaviors", "sensors"),
    "channels": ("behaviors", "channels"),
    "metrics": ("behaviors", "metrics"),
    "axes": ("behaviors", "device", "axes"),
    "branches": ("behaviors", "device", "branches"),
}


def parts_of(spec: pb.GameSpec, kind: str) -> list[Any]:
    """Return all parts of one kind. Raises NotApplicable if there are none."""
    parts: list[Any] = [spec]
    for field in PATHS[kind]:
        parts = [inner for part in parts for inner in _field(part, field)]
    skip_unless(parts, f"the game has no {kind}")
    return parts


def expect_each(
    spec: pb.GameSpec, kind: str, fields: Sequence[str], holds: Callable[[Any], object], expected: str
) -> None:
    """Raise Violation, which shows `fields`, unless `holds` is true for each part of one kind."""
    for part in parts_of(spec, kind):
        seen = ", ".join(f"{field} {str(getattr(part, field))[:200]}" for field in fields)
        expect(holds(part), f"{seen} of {getattr(part, 'name', kind)!r}", expected)


def expect_bounds(spec: pb.GameSpec, where: str = "") -> None:
    """Raise Violation, which begins with `where`, unless a spec is within the bounds that the manual states."""
    try:
        check_spec(spec)
    except SpecError as error:
        raise Violation(f"{where}{error}", "a spec within the bounds of bridge.proto") from error


def expect_unique_names(items: Iterable[object], what: str) -> None:
    """Raise Violation unless every name is unique and not empty."""
    names = names_of(items)
    expect(all(names) and len(set(names)) == len(names), f"{what} {names}", "unique names that are not empty")


def names_of(items: Iterable[object]) -> list[str]:
    """Return the names of some messages."""
    return [str(getattr(item, "name", "")) for item in items]


def _field(part: Any, name: str) -> list[Any]:
    """Return what a field holds: its entries if it is repeated, one message, or none if it is absent."""
    value = getattr(part, name)
    if hasattr(value, "DESCRIPTOR"):
        return [value] if part.HasField(name) else []
    return list(value)
