"""What stands behind `--unity` and `--unity-port`: a build or a port, and settings for its players."""

from collections.abc import Callable
from dataclasses import dataclass, field
from math import isfinite
from typing import Any

from joybridge.adapters.settings import AdapterError, read_settings
from joybridge.simulator import parameter
from joybridge.v1 import bridge_pb2 as pb

PARAMETER = "parameters."  # before the name of an environment parameter


@dataclass(frozen=True)
class UnitySettings:
    """How players are started and told what to do. The defaults of the engine are those of mlagents-learn."""

    place: str  # of the build, or the first port
    areas: int = 1  # arenas of one player
    players: int = 1  # that one session may use
    agents: dict[str, int] = field(default_factory=dict)  # most agents per arena, of behaviors that are not shown soon
    metrics: tuple[str, ...] = ()  # names of statistics
    parameters: tuple[pb.Parameter, ...] = ()  # environment parameters
    name: str = ""  # of the game; default: of the build
    args: str = ""  # further arguments of the build
    logs: str = ""  # folder for the logs of players
    no_graphics: bool = False
    any_seed: bool = False  # for players that are started by hand: play on for any seed
    seed: int = 0  # of players that are started by hand
    start: float = 60.0  # seconds for a player to connect
    wait: float = 20.0  # seconds for a player to answer
    width: int = 84
    height: int = 84
    quality: int = 5
    time_scale: float = 20.0
    target_frame_rate: int = -1
    capture_frame_rate: int = 60


def read_unity_settings(text: str, **defaults: Any) -> UnitySettings:
    """Return the settings in "PLACE KEY=VALUE …". Raises AdapterError."""
    place, given = read_settings(text, dotted=True)
    values: dict[str, Any] = {}
    parameters = []
    for key, value in given.items():
        if key.startswith(PARAMETER):
            parameters.append(_parameter(key.removeprefix(PARAMETER), value))
        elif key in READERS:
            values[key] = READERS[key](key, value)
        else:
            raise AdapterError(f"got the setting {key!r}, expected one of {', '.join(READERS)}, {PARAMETER}NAME")
    return UnitySettings(place, parameters=tuple(parameters), **(defaults | values))


def _parameter(name: str, value: Any) -> pb.Parameter:
    if not (isinstance(value, list) and len(value) == 3 and all(_is_number(one) for one in value)):
        raise AdapterError(
            f"{PARAMETER}{name}: got {value!r}, expected [LOW,HIGH,DEFAULT] without spaces, as in "
            f"{PARAMETER}{name}=[0,10,9.81]"
        )
    if not value[0] <= value[2] <= value[1]:
        raise AdapterError(f"{PARAMETER}{name}: the default {value[2]:g} is outside {value[0]:g}..{value[1]:g}")
    return parameter(name, *value)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and isfinite(value)


def _text(key: str, value: Any) -> str:
    return str(value)


def _truth(key: str, value: Any) -> bool:
    if not isinstance(value, bool):
        raise AdapterError(f"{key}: got {value!r}, expected true or false")
    return value


def _whole(low: int, high: int) -> Callable[[str, Any], int]:
    def read(key: str, value: Any) -> int:
        if not (_is_number(value) and value == int(value) and low <= value <= high):
            raise AdapterError(f"{key}: got {value!r}, expected a whole number in {low}..{high}")
        return int(value)

    return read


def _positive(key: str, value: Any) -> float:
    if not (_is_number(value) and value > 0):
        raise AdapterError(f"{key}: got {value!r}, expected a positive number")
    return float(value)


def _names(key: str, value: Any) -> tuple[str, ...]:
    return tuple(str(value).split(","))


def _agents(key: str, value: Any) -> dict[str, int]:
    agents = {}
    for entry in str(value).split(","):
        name, colon, count = entry.rpartition(":")
        if not (colon and name and count.isdecimal() and 1 <= int(count) <= 1000):
            raise AdapterError(f"{key}: got {entry!r}, expected BEHAVIOR:COUNT, as in hunter:2,runner:1")
        agents[name] = int(count)
    return agents


READERS: dict[str, Callable[[str, Any], Any]] = {
    "areas": _whole(1, 4096), "players": _whole(1, 256), "agents": _agents, "metrics": _names, "name": _text,
    "args": _text, "logs": _text, "no_graphics": _truth, "any_seed": _truth, "seed": _whole(0, 2**31 - 1),
    "start": _positive, "wait": _positive, "width": _whole(1, 2**15), "height": _whole(1, 2**15),
    "quality": _whole(0, 100), "time_scale": _positive, "target_frame_rate": _whole(-1, 10**6),
    "capture_frame_rate": _whole(0, 10**6),
}  # fmt: skip
