"""What the environments have in common: their arguments, checked, and what an agent of one has of them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from joybridge.client.own_games import Game, Games
from joybridge.config.errors import ConfigError
from joybridge.config.game_settings import Value, check_value
from joybridge.layouts import Role

FORBIDDEN = ("error", "first_allowed")  # what to do with a choice that its mask forbids


@dataclass(frozen=True, kw_only=True)
class EnvSettings:
    """The arguments of an environment; BridgeVectorEnv describes them. Raises ConfigError."""

    game: Game
    arenas: int
    layout: str
    frame_stack: int
    flatten: bool
    seed: int
    options: Mapping[str, str] | None
    parameters: Mapping[str, Value] | None
    sensors: Any  # names of sensors, by agent where an environment has several
    reward_weights: Any  # weights by reward channel, by agent where an environment has several
    forbidden: str
    games: Games
    simulator: str | None
    render_mode: str | None
    others: Sequence[str]  # who hold all seats but the first

    def __post_init__(self) -> None:
        """Check what is not checked by the simulator."""
        for name in ("arenas", "frame_stack"):
            if not isinstance(value := getattr(self, name), int | np.integer) or value < 1:
                raise ConfigError(f"{name} is {value!r}, expected an integer of at least 1")
            object.__setattr__(self, name, int(value))
        if not isinstance(self.layout, str):
            raise ConfigError(f"layout is {self.layout!r}, expected the name of one, as 'hybrid'")
        for name, choice in (self.options or {}).items():
            if not isinstance(choice, str):
                raise ConfigError(f"options.{name} is {choice!r}, expected one of its choices, in quotes")
        for name in ("sensors", "others"):
            if isinstance(value := getattr(self, name), str):
                raise ConfigError(f"{name} is {value!r}, expected a list of names, as [{value!r}]")
        if self.forbidden not in FORBIDDEN:
            raise ConfigError(f"forbidden is {self.forbidden!r}, expected one of {', '.join(FORBIDDEN)}")
        if self.render_mode not in (None, "rgb_array"):
            raise ConfigError(f"render_mode is {self.render_mode!r}, expected None or 'rgb_array'")
        check_seed(self.seed)
        for name, value in (self.parameters or {}).items():
            check_value(name, value)


class Seat(NamedTuple):
    """Where a player sits: the role of its policy, and the number of its agent in each arena; None: all agents."""

    role: Role
    lane: int | None


def check_seed(seed: Any) -> int:
    """Return a seed as an int of Python. Raises ConfigError for one that the contract cannot carry."""
    if not isinstance(seed, int | np.integer) or not 0 <= seed < 2**64:
        raise ConfigError(f"seed is {seed!r}, expected one int of 0..2^64-1, which seeds all arenas")
    return int(seed)
