"""Formats of demonstrations: our own, and those that installed packages add by entry points."""

from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

from joybridge.demonstrations.recorded import Demonstration
from joybridge.plugins import find
from joybridge.v1 import bridge_pb2 as pb


class Format(NamedTuple):
    """A format of demonstrations, an entry point of `joybridge.demonstrations`."""

    kind: str  # in words: "a dataset of Minari"
    patterns: tuple[str, ...]  # of its files in a folder of demonstrations, as for `Path.glob`
    find: Callable[[Path], Path | None]  # the file of the format at a path, or in the folder there
    load: Callable[[Path, pb.GameSpec], Demonstration]  # raises RecordingError and ConfigError


@cache
def foreign_formats() -> list[Format]:
    """Return the formats of installed packages."""
    return [point.load() for point in find("joybridge.demonstrations")]


def formats_of(path: Path) -> Iterator[Format]:
    """Yield the foreign formats that a file or folder has, one at most."""
    yield from (one for one in foreign_formats() if one.find(path))
