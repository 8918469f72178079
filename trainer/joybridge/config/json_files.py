"""JSON files in the folders of runs, which somebody may have damaged."""

from pathlib import Path
from typing import TypeVar

from pydantic import TypeAdapter, ValidationError

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
        raise ConfigError(f"{path} cannot be read ({reason_of(error)}); {advice}") from error


def reason_of(error: Exception) -> str:
    """Return what is wrong with a file in a few words: with the first wrong field, if pydantic names any."""
    if isinstance(error, ValidationError):
        first = error.errors(include_input=False, include_url=False)[0]
        where = ".".join(map(str, first["loc"]))
        return f"{where}: {first['msg']}" if where else str(first["msg"])
    return str(error).partition("\n")[0]
