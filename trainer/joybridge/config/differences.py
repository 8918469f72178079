"""What differs between two configurations or specs, in words."""

import json
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

MAX_DIFFERENCES = 3  # that an error names


def differences(before: Any, now: Any, key: str = "") -> Iterator[tuple[str, Any, Any]]:
    """Yield what differs in two trees of plain data: its dotted key, what it was and what it is."""
    if isinstance(before, list) and isinstance(now, list) and len(before) == len(now):
        before, now = dict(enumerate(before)), dict(enumerate(now))
    if isinstance(before, Mapping) and isinstance(now, Mapping):
        for name in [*before, *(name for name in now if name not in before)]:
            yield from differences(before.get(name), now.get(name), f"{key}.{name}" if key else f"{name}")
    elif before != now:
        yield key, before, now


def flat(data: Mapping[str, Any], before: str = "") -> dict[str, Any]:
    """Return the values of nested mappings by their dotted keys; lists and empty mappings are values."""
    found: dict[str, Any] = {}
    for key, value in data.items():
        found |= flat(value, f"{before}{key}.") if isinstance(value, dict) and value else {f"{before}{key}": value}
    return found


def in_words(changed: Sequence[tuple[str, Any, Any]]) -> str:
    """Return what has changed as a part of a sentence."""
    texts = [f"{key} was {json.dumps(was)} and is now {json.dumps(now)}" for key, was, now in changed[:MAX_DIFFERENCES]]
    more = f", and {len(changed) - MAX_DIFFERENCES} more" if len(changed) > MAX_DIFFERENCES else ""
    return ", ".join(texts) + more
