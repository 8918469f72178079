"""What users name in a configuration as "module:name": their own network, term of the loss or layout."""

import pkgutil
import sys
from pathlib import Path
from typing import Any

from joybridge.config.errors import ConfigError
from joybridge.contract.text import printable


def load_own(key: str, name: str) -> Any:
    """Return what "module:name" names; modules are looked for in the current folder, too. Raises ConfigError."""
    if (folder := str(Path.cwd())) not in sys.path:  # the script `joybridge` does not search the current folder
        sys.path.append(folder)
    try:
        return pkgutil.resolve_name(name)
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # what a module raises when it is imported, exit() included
        text = printable(f"{type(error).__name__}: {error}")
        raise ConfigError(f"{key}: {name!r} cannot be imported: {text}") from error
