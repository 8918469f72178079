"""Machine code that Numba has kept on disk is deleted when a source beside it is newer.

Numba looks at the file of a function alone. If a constant that the function takes from another file changes, it goes on
with the old one, and if a type is renamed, it cannot even read its index.
"""

from contextlib import suppress
from functools import cache
from pathlib import Path

__all__ = ["delete_stale"]


@cache
def delete_stale(source: str) -> None:
    """Delete the machine code in the folder of a source file that is older than any source there.

    What cannot be deleted stays: Numba compiles again where its own check fails.
    """
    folder = Path(source).parent
    newest = max((path.stat().st_mtime_ns for path in folder.glob("*.py")), default=0)
    for path in (folder / "__pycache__").glob("*.nb[ic]"):
        with suppress(OSError):  # another process may be deleting the same
            if path.stat().st_mtime_ns < newest:
                path.unlink()
