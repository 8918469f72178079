r"""What stands behind `--pygame`: a program, settings for it, and after `--` its own arguments.

chimp.py keys=SPACE,LEFT 'reward=Score: (\d+)' reward=sound:punch.wav 'done=Game over' -- --level 3
"""

import re
import shlex
from dataclasses import dataclass, field
from pathlib import Path

from joybridge.adapters.pygame_programs.wire import nth_text
from joybridge.adapters.settings import AdapterError
from joybridge.contract.places import NAMES, program_name

REPEATED = {"reward", "done"}
NUMBERS = {  # the default of each, and its range
    "fps": (60.0, 1.0, 1000.0),
    "seconds": (10.0, 0.1, 3600.0),
    "start": (60.0, 0.1, 3600.0),
    "memory": (2048, 128, 1 << 20),
    "max_decisions": (1024, 1, 100_000),
}
TEXTS = {"name", "hook", "tapes"}
FLAGS = {"mouse", "wheel", "joystick", "snapshots", "window", "skip_drawing"}


@dataclass(frozen=True)
class PygameSettings:
    """A program, and how it is run."""

    name: str  # of the game
    text: str  # all that was given
    place: str  # FILE, MODULE or PACKAGE:SCRIPT
    arguments: list[str] = field(default_factory=list)
    rewards: dict[str, str] = field(default_factory=dict)  # by channel; see inside/rewards.py
    done: list[str] = field(default_factory=list)  # patterns of text
    numbers: dict[str, float] = field(default_factory=dict)
    names: dict[str, list[str]] = field(default_factory=dict)
    texts: dict[str, str] = field(default_factory=dict)
    flags: dict[str, bool] = field(default_factory=dict)

    def number(self, name: str) -> float:
        """Return a number, its default if it is not set."""
        return self.numbers.get(name, NUMBERS[name][0])

    @property
    def window(self) -> bool:
        """Return whether the program is played in its own window, in real time."""
        return self.flags.get("window", False)

    @property
    def skip_drawing(self) -> bool:
        """Return whether the program draws only the frames that somebody sees."""
        return self.flags.get("skip_drawing", False) and not self.window

    def inside(self) -> dict[str, object]:
        """Return what the process of the program needs to know."""
        return {
            "place": str(Path(self.place).resolve()) if Path(self.place).is_file() else self.place,
            "arguments": self.arguments,
            "rewards": self.rewards,
            "done": self.done,
            "hook": str(Path(self.texts["hook"]).resolve()) if "hook" in self.texts else "",
            "fps": self.number("fps"),
            "memory": int(self.number("memory")),
            "start": self.number("start"),
            "window": self.window,
            "joystick": self.flags.get("joystick"),
        }


def read_pygame_settings(text: str) -> PygameSettings:
    """Return the settings in "PROGRAM KEY=VALUE … -- ARGUMENTS". Raises AdapterError."""
    try:
        words, name = shlex.split(text), program_name(text)
    except ValueError as error:
        raise AdapterError(f"got {text!r}: {error}") from error
    words, arguments = (words[: words.index("--")], words[words.index("--") + 1 :]) if "--" in words else (words, [])
    settings = PygameSettings(name, text, words[0], arguments)
    for word in words[1:]:
        key, equals, value = word.partition("=")
        if not equals:
            raise AdapterError(f"got the argument {word!r}, expected KEY=VALUE; the program's own arguments follow --")
        _read(settings, key, value)
    return settings


def _read(settings: PygameSettings, key: str, value: str) -> None:
    if key == "reward":
        settings.rewards[_channel(value, settings.rewards)] = value
    elif key == "done":
        settings.done.append(value)
    elif key in NUMBERS:
        settings.numbers[key] = _number(key, value)
    elif key in NAMES:
        settings.names.setdefault(key, []).extend(name for name in value.split(",") if name)
    elif key in TEXTS:
        settings.texts[key] = value
    elif key in FLAGS and value in ("true", "false"):
        settings.flags[key] = value == "true"
    else:
        known = ", ".join(sorted([*REPEATED, *NUMBERS, *NAMES, *TEXTS, *FLAGS]))
        raise AdapterError(f"got {key}={value}, expected one of {known}; {', '.join(sorted(FLAGS))} are true or false")


def _number(key: str, value: str) -> float:
    default, low, high = NUMBERS[key]
    try:
        number = type(default)(value)
    except ValueError:
        number = low - 1
    if not low <= number <= high:
        raise AdapterError(f"got {key}={value}, expected a number in {low:g}..{high:g}")
    return number


def _channel(source: str, known: dict[str, str]) -> str:
    """Return a name for the channel of a reward: the last word of a variable or sound, the first of a pattern."""
    kind, _, place = source.partition(":")
    if kind == "sound":
        name = Path(place).stem
    elif kind == "attr":
        name = place.rpartition(".")[2]
    else:
        name = next(iter(re.findall(r"[A-Za-z]{2,}", nth_text(source)[1])), "reward").lower()
    return next(one for one in [name, *(f"{name}_{number}" for number in range(2, len(known) + 3))] if one not in known)
