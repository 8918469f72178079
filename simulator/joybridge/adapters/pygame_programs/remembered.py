"""What a first play has found out is kept for the next start: in $XDG_CACHE_HOME/joybridge, by default in ~/.cache.

It is found again by all on which it depends: the settings, the sources of the program, what runs them, and our own.
"""

import json
import os
from collections.abc import Mapping
from hashlib import blake2b
from pathlib import Path
from typing import Any

from joybridge.adapters.pygame_programs.first_play import FirstPlay, Number, first_play, is_end
from joybridge.adapters.pygame_programs.processes import ProgramProcesses
from joybridge.adapters.pygame_programs.settings import PygameSettings


def recall_or_play(processes: ProgramProcesses, shown: Mapping[str, Any]) -> FirstPlay:
    """Return what is known of a program whose first look has shown something; play it if nothing is.

    Raises AdapterError, and GameError if it soon fails.
    """
    path = _path(processes.settings, shown["sources"])
    found = _read(path)
    if found is None:
        found = first_play(processes, shown)
        _write(path, found)
    return found


def _path(settings: PygameSettings, sources: str) -> Path | None:
    """Return where a first play is kept; None if there is no home for it."""
    base = Path(os.environ.get("XDG_CACHE_HOME", ""))
    try:
        folder = (base if base.is_absolute() else Path.home() / ".cache") / "joybridge" / "first_plays"
        own = [path.read_bytes() for path in sorted(Path(__file__).parent.rglob("*.py"))]
        hook = Path(settings.texts["hook"]).read_bytes() if "hook" in settings.texts else b""
    except (OSError, RuntimeError):
        return None
    facts = [settings.inside(), settings.numbers, settings.names, settings.flags, sources]
    digest = blake2b(json.dumps(facts, sort_keys=True).encode(), digest_size=16)
    for data in (hook, *own):
        digest.update(data)
    return folder / f"{digest.hexdigest()}.json"


def _read(path: Path | None) -> FirstPlay | None:
    try:
        found = json.loads(path.read_bytes()) if path else None
        if not found:
            return None
        numbers = [Number(*number) for number in found["numbers"]]
        remarks = [str(remark) for remark in found["remarks"]]
        return FirstPlay(list(found["read"]), float(found["frame_seconds"]), bool(found["exact"]), numbers, remarks)
    except (OSError, ValueError, TypeError, KeyError):
        return None


def _write(path: Path | None, found: FirstPlay) -> None:
    """Keep what was found, if that is possible."""
    if path is None:
        return
    part = path.with_suffix(f".{os.getpid()}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        # An end that random play has not reached is said once: it need not.
        remarks = [remark for remark in found.remarks if not is_end(remark)]
        part.write_text(json.dumps(found._replace(remarks=remarks)._asdict()), encoding="utf-8")
        part.replace(path)
    except OSError:
        return
