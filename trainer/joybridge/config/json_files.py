"""JSON files in the folders of runs, which somebody may have damaged."""

from pathlib import Path
from typing import TypeVar

from pydantic import TypeAdapter

from joybridge.config.errors import ConfigError
from joybridge.contract.files import read_file

T = TypeVar("T")

ONLY_FOR_PEOPLE = "delete it, it is only for people"  # advice for a damaged file


def read_json(path: Path, kind: TypeAdapter[T], most: int, advice: str) -> T | None:
    """Return what a JSON file of at most `most` bytes holds; None if there is no file.

    Raises ConfigError for a file that is not of this kind, with `advice` on what to do.
    """
    try:
        return kind.validate_json(read_file(path, most))
    except FileNotFoundError:
        return None
    except (OSError, ValueError) as error:
        reason = str(error).partition("\n")[0]
        raise ConfigError(f"{path} cannot be read ({reason}); {advice}") from error
