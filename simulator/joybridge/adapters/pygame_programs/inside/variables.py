"""Variables of the program by dotted paths: of modules, of objects in them, and of functions that run."""

import sys
from collections.abc import Mapping
from pathlib import Path
from types import FrameType
from typing import Any

OURS = str(Path(__file__).parent)  # functions of the same name in it are not the program's


def look_up(path: str) -> Any:
    """Return what is at a dotted path, as in "main.player.lives", None where there is nothing at present.

    It begins with a module, a variable of the program's main module, or the name of a function that runs.
    """
    parts = path.split(".")
    for end in range(len(parts) - 1, 0, -1):
        module = sys.modules.get(".".join(parts[:end]))
        if module is not None:
            return _follow(vars(module), parts[end:])
    main = vars(sys.modules["__main__"])
    if parts[0] in main and (len(parts) == 1 or not callable(main[parts[0]]) or isinstance(main[parts[0]], type)):
        return _follow(main, parts)
    frame: FrameType | None = sys._getframe()
    while frame is not None and len(parts) > 1:
        if frame.f_code.co_name == parts[0] and not frame.f_code.co_filename.startswith(OURS):
            return _follow(frame.f_locals, parts[1:])
        frame = frame.f_back
    return None


def number_at(path: str) -> float | None:
    """Return the number at a dotted path, or how many a container there holds; None where there is neither."""
    found = look_up(path)
    try:
        return float(len(found)) if isinstance(found, list | dict | set | tuple) else float(found)
    except (TypeError, ValueError):
        return None


def _follow(names: Mapping[str, Any], parts: list[str]) -> Any:
    found: Any = names.get(parts[0])
    for part in parts[1:]:
        found = found.get(part) if isinstance(found, Mapping) else getattr(found, part, None)
    return found
