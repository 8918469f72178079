"""Parts that installed packages add by entry points: our own optional ones and those of others alike.

| group | what an entry point names | used by |
|---|---|---|
| `joybridge.commands` | a `Command` | `joybridge.cli` |
| `joybridge.games` | a `Game` or `BatchedGame` | the simulator's catalog |
| `joybridge.layouts` | a function that makes a layout | `joybridge.layouts` |
| `joybridge.demonstrations` | a `Format` of demonstrations | `joybridge.demonstrations` |
| `joybridge.configurations` | a function that translates configurations of another trainer | `joybridge.config` |
| `joybridge.opponents` | a function that seats others beside a player of `joybridge.gym` | `joybridge.gym` |
| `joybridge.clusters` | what starts simulators or runs on other machines | `joybridge.client`, `joybridge.compare` |
"""

from importlib.metadata import EntryPoint, entry_points
from typing import Any

__all__ = ["find", "load"]


def find(group: str) -> list[EntryPoint]:
    """Return the entry points of a group, nothing of them imported yet."""
    return list(entry_points(group=group))


def load(group: str, name: str) -> Any:
    """Import what the entry point of a name in a group refers to. Raises LookupError if no package has it."""
    for point in find(group):
        if point.name == name:
            return point.load()
    raise LookupError(f"no installed package has {name!r} in {group}; install Joybridge again")
