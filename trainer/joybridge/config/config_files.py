"""Files of configurations: finding them, by path or by the name of an installed one, and reading them.

A YAML file (version 1.2) may name another one, or an installed one, with `extends:`; mappings are merged, everything
else is replaced.

The wheel holds `configs/` as `joybridge/configs`. An editable install has no copy of it and reads the checkout's own.
"""

import difflib
import io
from collections.abc import Sequence
from copy import deepcopy
from functools import lru_cache
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError
from ruamel.yaml.events import CollectionEndEvent, CollectionStartEvent, ScalarEvent

from joybridge.config.errors import ConfigError
from joybridge.config.game_settings import KINDS
from joybridge.config.presets import preset_of
from joybridge.contract.files import read_file

_INSTALLED = Path(__file__).parents[1] / "configs"  # joybridge/configs of a wheel
_CHECKOUT = Path(__file__).parents[3] / "configs"
FOLDER = _INSTALLED if _INSTALLED.is_dir() else _CHECKOUT
MAX_CONFIG_SIZE = 2**16  # bytes of a file, and values in it
DEEPEST = 10  # mappings and lists inside each other; files that extend each other
MERGE = "<<"  # a key whose value YAML lays under the other keys
OPENING = "[{-:?"  # each mapping and list has one of these characters
BASE = "common"  # stem of files that other files extend; they are not trained themselves


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
    of_game = [known for known in names if name.partition("/")[0] in known.split("/")]
    near = in_folder or of_game or difflib.get_close_matches(name, names, n=3)
    files = [path.as_posix() for path in sorted(Path(text).parent.glob("*.yaml"))]
    near = difflib.get_close_matches(text, files, n=3) or near
    games = sorted({known.partition("/")[0] for known in names})
    hint = f"did you mean {', '.join(near)}?" if near else f"there are some for {', '.join(games)}; name one of those"
    raise ConfigError(f"there is no configuration {text!r}: no such file, and none of that name is installed; {hint}")


def read_yaml(path: Path, seen: tuple[Path, ...] = ()) -> dict[str, Any]:
    """Return the keys and values of a file, on top of its preset and of what it extends. Raises ConfigError."""
    if path.suffix == ".py":
        raise ConfigError(
            f"{path} is a program, no configuration; `joybridge new --pygame {path}` writes one, if it uses pygame"
        )
    try:
        real, text = path.resolve(), read_file(path, MAX_CONFIG_SIZE).decode("utf-8")
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path} is not YAML: {error}") from error
    except OSError as error:
        raise ConfigError(f"cannot read the configuration {path}: {error.strerror}") from error
    except (ValueError, RuntimeError) as error:  # a path with a null character, a circle of links
        raise ConfigError(f"cannot read the configuration {str(path)!r}: {error}") from error
    if real in seen:
        raise ConfigError(f"{path}: `extends` leads back to the file itself")
    if len(seen) == DEEPEST:
        raise ConfigError(f"{path}: `extends` leads through more than {DEEPEST} files")
    data = parse_yaml(text, str(path))
    if not isinstance(data, dict):
        raise ConfigError(f"{path} holds {type(data).__name__}, expected keys and values")
    base = data.pop("extends", None)
    data = merge(preset_of(data), data)
    if base is None:
        return _with_bare_games({}, data)
    beside, name = path.parent / str(base), str(base).removesuffix(".yaml")
    installed = name in config_names() and not beside.is_file()
    extended = read_yaml(FOLDER / f"{name}.yaml" if installed else beside, (*seen, real))
    return merge(extended, _with_bare_games(extended, data))


def _with_bare_games(extended: dict[str, Any], data: dict[str, Any]) -> dict[str, Any]:
    """Return a file in which a game without keys, null in YAML, has none; where the extended file has it, it is out."""
    games, known = data.get("games"), extended.get("games")
    if not isinstance(games, dict):
        return data
    bare: dict[str, Any] = {name: {} for name, keys in games.items() if keys is None and name not in (known or {})}
    return {**data, "games": games | bare}


def read_overrides(overrides: Sequence[str]) -> dict[str, Any]:
    """Return what "key=value" overrides set, as a file would. Raises ConfigError."""
    data: dict[str, Any] = {}
    for override in overrides:
        key, equals, text = override.partition("=")
        if not equals or not key:
            raise ConfigError(f"override {override!r} is not of the form key=value")
        value, parts = parse_yaml(text, f"override {override!r}: {text!r}"), key.split(".")
        if len(parts) > DEEPEST:
            raise ConfigError(f"the key of an override has {len(parts):,} parts, expected {DEEPEST} at most")
        for part in reversed(parts):
            value = {part: value}
        data = merge(data, value)
    return data


def parse_yaml(text: str, what: str) -> Any:
    """Return the content of a YAML text; `what` names it in errors. Raises ConfigError."""
    try:
        return deepcopy(_parse(text))
    except (
        YAMLError,
        ValueError,
        LookupError,
    ) as error:  # a date that does not exist, a value of a type like `!!int ''`
        problem = getattr(error, "problem", None) or str(error)
        mark = getattr(error, "problem_mark", None)
        where = f" in line {mark.line + 1}" if mark is not None else ""
        raise ConfigError(f"{what} is not YAML{where}: {problem}") from error


@lru_cache(256)  # a comparison or a search reads the same files and overrides hundreds of times
def _parse(text: str) -> Any:
    """Return the content of a YAML text. Raises YAMLError and ValueError."""
    _check_events(text)
    data = YAML(typ="safe", pure=True).load(text)
    _check_size(data)
    return data


def _check_events(text: str) -> None:
    """Raise ValueError for a text that would take very long to read: deeply nested, or with keys that are merged.

    Merges multiply: `<<: [*a, *a]` in each of forty mappings never ends.
    """
    if sum(map(text.count, OPENING)) <= DEEPEST and MERGE not in text:
        return
    depth = 0
    for event in YAML(typ="safe", pure=True).parse(text):
        depth += isinstance(event, CollectionStartEvent) - isinstance(event, CollectionEndEvent)
        if depth > DEEPEST:
            raise ValueError(f"it is nested more than {DEEPEST} times")
        if isinstance(event, ScalarEvent) and event.value == MERGE and event.style is None:
            raise ValueError(f"it has the key `{MERGE}`; write the keys themselves, or use `extends`")


def _check_size(data: Any) -> None:
    """Raise ValueError if YAML's aliases (`*name`) make the content very much larger than its text."""
    left, parts = MAX_CONFIG_SIZE, [data]
    while parts:
        part = parts.pop()
        left -= 1 + (len(part) if isinstance(part, str) else 0)
        if left < 0:
            raise ValueError("its aliases make it too large")
        if isinstance(part, dict):
            parts += [*part.keys(), *part.values()]
        elif isinstance(part, list | tuple | set):
            parts += part


def dump_yaml(data: dict[str, Any]) -> str:
    """Return keys and values as YAML."""
    yaml, text = YAML(typ="safe", pure=True), io.StringIO()
    yaml.default_flow_style = False
    yaml.sort_base_mapping_type_on_output = False  # type: ignore[assignment]
    yaml.dump(data, text)
    return text.getvalue()


def merge(base: dict[str, Any], over: dict[str, Any]) -> dict[str, Any]:
    """Return `base` with `over` laid on top; mappings are merged, everything else is replaced.

    A mapping on top of a list, {"0": …}, replaces or merges its items by their numbers. A distribution, such as
    {"uniform": […]}, is replaced as a whole.
    """
    return {**base, **{key: _laid(base.get(key), value) for key, value in over.items()}}


def _laid(base: Any, over: Any) -> Any:
    """Return a value that is laid on top of another, as `merge` does."""
    if isinstance(base, dict) and isinstance(over, dict):
        return over if {*KINDS}.issuperset(base) and base and {*KINDS}.issuperset(over) else merge(base, over)
    if isinstance(base, list) and isinstance(over, dict) and over:
        items = {str(number): item for number, item in enumerate(base)}
        if over.keys() <= items.keys():
            return [_laid(item, over.get(number, item)) for number, item in items.items()]
    return over
