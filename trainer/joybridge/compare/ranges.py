"""What a search may change: the ranges and choices of keys, how they are written, and whether a configuration has them.

`KEY=LOW..HIGH` is a range of numbers, whole ones if the key wants them; `KEY=LOW..HIGH:log` is searched by magnitude;
`KEY=VALUE,VALUE,…` are choices, as for `--set`.
"""

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from joybridge.compare.variants import read_values
from joybridge.config.config import Config, load_config
from joybridge.config.errors import ConfigError
from joybridge.config.overrides import split_values

NOT_SEARCHED = {  # keys that are not searched, and why
    "seed": "all trials have the same seed; compare the best settings over seeds afterwards",
    "game": "scores of two games cannot be compared; search once for each",
    "options": "options change what a game pays; search once for each",
    "total_timesteps": "trials of other lengths cannot be compared",
    "stop_at": "trials of other lengths cannot be compared",
    "log_interval": "trials are compared where they have rows of metrics",
}
PRUNE_FROM = 0.2  # of a training: where trials that fall behind may end, unless the search says so
MAX_WHOLE = 2**53  # larger whole numbers are not exact as float64
FORM = "KEY=LOW..HIGH, KEY=LOW..HIGH:log or KEY=VALUE,VALUE,…"
EXAMPLE = "policy.learning_rate=1e-5..1e-3:log"


@dataclass(frozen=True)
class Numbers:
    """A range of numbers, both ends included."""

    key: str
    low: float
    high: float
    log: bool
    whole: bool  # only integers

    def write(self, value: float) -> str:
        """Return a number of the range as it is written in a setting, with at most six digits."""
        text = f"{value}" if self.whole else f"{value:.6g}"
        return text if self.low <= float(text) <= self.high else f"{min(max(value, self.low), self.high)!r}"

    def read(self, text: str) -> float | None:
        """Return the number that a setting means; None if it is not in the range."""
        try:
            value = int(text) if self.whole else float(text)
        except ValueError:
            return None
        return value if self.low <= value <= self.high else None

    def __str__(self) -> str:
        ends = (f"{int(end)}" if self.whole else f"{end!r}" for end in (self.low, self.high))
        return f"{self.key}={'..'.join(ends)}{':log' if self.log else ''}"


@dataclass(frozen=True)
class Choices:
    """Several values, as they are written."""

    key: str
    values: tuple[str, ...]

    def write(self, value: str) -> str:
        """Return a value as it is written in a setting."""
        return value

    def read(self, text: str) -> str | None:
        """Return the value that a setting means; None if it is not one of the choices."""
        return text if text in self.values else None

    def __str__(self) -> str:
        return f"{self.key}={','.join(self.values)}"


Range = Numbers | Choices


def read_ranges(texts: Sequence[str], path: Path, overrides: Sequence[str]) -> list[Range]:
    """Return the ranges, in the order of their keys. Raises ConfigError.

    path: the configuration that is searched around; overrides: what all trials share, KEY=VALUE each.
    """
    shared = {override.partition("=")[0] for override in overrides}
    ranges: dict[str, Range] = {}
    for text in texts:
        made = _read_range(text, path, overrides)
        if made.key in shared or made.key in ranges:
            raise ConfigError(f"{made.key} is set twice; set it once, or search it")
        ranges[made.key] = made
    return [ranges[key] for key in sorted(ranges)]


def settings_of(ranges: Sequence[Range], params: Mapping[str, Any]) -> dict[str, str]:
    """Return what was chosen within the ranges as it is written, by key."""
    return {each.key: each.write(params[each.key]) for each in ranges}


def is_fixed(text: str) -> bool:
    """Return whether a text sets a key to one value, so that nothing is searched."""
    value = text.partition("=")[2]
    path = "/" in value  # which may begin with two dots
    return bool(value) and (path or ".." not in value) and len(split_values(value)) == 1


def _read_range(text: str, path: Path, overrides: Sequence[str]) -> Range:
    key, equals, rest = text.partition("=")
    if not key or not equals or not rest:
        raise ConfigError(f"--search got {text!r}, expected {FORM}, as in {EXAMPLE}")
    for name in (key, key.partition(".")[0]):
        if name in NOT_SEARCHED:
            raise ConfigError(f"--search {text}: {key} is not searched, because {NOT_SEARCHED[name]}")

    def configured(value: str) -> Config:
        try:
            return load_config(path, [*overrides, f"{key}={value}"])
        except ConfigError as error:
            raise ConfigError(f"--search {text}: {error}") from error

    if ".." in rest and "," not in rest:
        low, high, log = _read_ends(text, rest)
        first, last = (value_at(configured(end), key) for end in (low, high))
        if type(first) not in (int, float) or type(last) is not type(first):
            raise ConfigError(f"--search {text}: {key} is no number; list its values, as in {key}=VALUE,VALUE")
        if type(first) is int and max(-first, last) > MAX_WHOLE:
            raise ConfigError(f"--search {text}: the range is too large, expected whole numbers up to {MAX_WHOLE:,}")
        return Numbers(key, first, last, log, type(first) is int)
    values = read_values(text, "--search")[1]
    configs = [configured(value) for value in values]
    for index, config in enumerate(configs):
        if config in configs[:index]:
            same = values[configs.index(config)]
            raise ConfigError(f"--search {text}: {same} and {values[index]} are the same; name each value once")
    return Choices(key, tuple(values))


def _read_ends(text: str, rest: str) -> tuple[str, str, bool]:
    """Return the ends of a range as they are written, and whether it is searched by magnitude. Raises ConfigError."""
    found = re.fullmatch(r"(.+?)\.\.(.+?)(:log)?", rest)
    try:
        low, high = (float(end) for end in found.group(1, 2)) if found else (math.nan, math.nan)
    except ValueError:
        low = high = math.nan
    if found is None or not math.isfinite(high - low):
        raise ConfigError(f"--search got {text!r}, expected {FORM} with numbers, as in {EXAMPLE}")
    if low == high:
        raise ConfigError(f"--search {text}: both ends are equal; write {text.partition('..')[0]} behind the options")
    if low > high:
        raise ConfigError(f"--search {text}: the range is empty; write the lower end first, {found[2]}..{found[1]}")
    if found[3] and low <= 0:
        raise ConfigError(f"--search {text}: {found[1]} has no logarithm; begin above 0, or leave out :log")
    return found[1], found[2], bool(found[3])


def value_at(config: Config, key: str) -> Any:
    """Return the value of a dotted key; None if the configuration does not set it."""
    value: Any = config
    parts = key.split(".")
    if parts[0] == "policies" and len(parts) > 2:
        value, parts = config.policy_config(parts[1]), parts[2:]
    for part in parts:
        value = value.get(part) if isinstance(value, dict) else getattr(value, part, None)
    return value


def own_settings(ranges: Sequence[Range], config: Config, path: Path, overrides: Sequence[str]) -> dict[str, str]:
    """Return the settings that the configuration has itself, by key; empty if one of them is out of its range."""
    settings = {}
    for each in ranges:
        if isinstance(each, Numbers):
            text = f"{value_at(config, each.key)}"
            own = text if each.read(text) is not None else None
        else:
            same = (text for text in each.values if load_config(path, [*overrides, f"{each.key}={text}"]) == config)
            own = next(same, None)
        if own is None:
            return {}
        settings[each.key] = own
    return settings
