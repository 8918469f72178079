"""Find a configuration by the name of its file or by its name among those that are installed with Joybridge.

The wheel holds `configs/` as `joybridge/configs`. An editable install has no copy of it and reads the checkout's own.
"""

import difflib
from pathlib import Path

from joybridge.trainer.errors import ConfigError

_INSTALLED = Path(__file__).parents[1] / "configs"  # joybridge/configs of a wheel
_CHECKOUT = Path(__file__).parents[3] / "configs"
FOLDER = _INSTALLED if _INSTALLED.is_dir() else _CHECKOUT
BASE = "common"  # stem of files that others extend and nobody trains


def config_names() -> list[str]:
    """Return the names of the installed configurations, sorted, e.g. "shooting_birds/bucket-11"."""
    paths = (path.relative_to(FOLDER).with_suffix("") for path in FOLDER.glob("*/*.yaml"))
    return sorted(path.as_posix() for path in paths if path.name != BASE)


def find_config(text: str) -> Path:
    """Return the path of a configuration: an existing file, or an installed name with or without ".yaml".

    Raises ConfigError, which names similar configurations.
    """
    if Path(text).is_file():
        return Path(text)
    name = text.removesuffix(".yaml")
    names = config_names()
    if name in names:
        return FOLDER / f"{name}.yaml"
    in_folder = [known for known in names if name.strip("/") in known.split("/")]  # only the game, or only the stem
    near = in_folder or difflib.get_close_matches(name, names, n=3)
    hint = f"did you mean {', '.join(near)}?" if near else f"installed are {', '.join(names)}"
    raise ConfigError(f"there is no configuration {text!r}: no such file, and none of that name is installed; {hint}")
