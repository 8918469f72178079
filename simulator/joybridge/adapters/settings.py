"""What stands behind `--gym`, `--pettingzoo` and `--unity`: an environment, and arguments for making it."""

import json
import shlex
from typing import Any

from joybridge.contract.errors import JoybridgeError

MAX_ARENAS = 128  # of a session: many an environment takes a tenth of a second to make
SEEDS = 2**31  # of `reset`; some environments accept no larger ones


class AdapterError(JoybridgeError):
    """An environment cannot be served as it is. The message names what is in the way."""


def read_settings(text: str, *, dotted: bool = False) -> tuple[str, dict[str, Any]]:
    """Return the environment and its arguments in "ENVIRONMENT KEY=VALUE …".

    A value is JSON, or text where it is not: goal=3, continuous=true, map_name=8x8. dotted: keys may have dots.
    Raises AdapterError.
    """
    try:
        environment, *settings = shlex.split(text) or [""]
    except ValueError as error:
        raise AdapterError(f"got {text!r}: {error}") from error
    arguments = {}
    for setting in settings:
        key, equals, value = setting.partition("=")
        if not (equals and (key.isidentifier() or (dotted and "." in key))):
            raise AdapterError(f"got the argument {setting!r}, expected KEY=VALUE")
        try:
            arguments[key] = json.loads(value)
        except ValueError:
            arguments[key] = value
    return environment, arguments
