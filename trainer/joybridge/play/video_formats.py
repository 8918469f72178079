"""The formats of videos. Needs neither torch nor av, so that a wrong one is refused at once."""

from pathlib import Path
from typing import NamedTuple

from joybridge.config.errors import ConfigError


class Format(NamedTuple):
    """How the pictures of a file are encoded."""

    codec: str
    pixels: str


H264 = Format("libx264", "yuv420p")
FORMATS = {".mp4": H264, ".mkv": H264, ".mov": H264, ".gif": Format("gif", "pal8")}


def video_format(output: Path) -> Format:
    """Return the format of a file by its name. Raises ConfigError for an unknown one."""
    suffix = output.suffix.lower()
    if suffix not in FORMATS:
        raise ConfigError(f"{output}: unknown video format {suffix!r}, expected {', '.join(FORMATS)}")
    return FORMATS[suffix]
