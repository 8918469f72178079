"""The keys of one game among several that one policy plays."""

import argparse
from typing import Annotated, Any

from pydantic import AfterValidator, BeforeValidator, Field

from joybridge.config.parameter_keys import Checked, Value
from joybridge.contract.address import address

SEVERAL = "several"  # the game of a configuration that has `games`
MAX_GAMES = 100


def _check_address(text: str) -> str:
    try:
        return address(text) if text else text
    except argparse.ArgumentTypeError as error:
        raise ValueError(str(error).partition(", ")[2]) from None


class GameConfig(Checked):
    """One of several games: what is played, and how much of it."""

    game: str = Field("", description="its name there, MODULE:CLASS or pygame:PROGRAM; left out: its name here")
    options: dict[str, str] = Field({}, description="options of the game")
    parameters: dict[str, Value] = Field({}, description="parameters of the game, or how they are drawn")
    share: float = Field(1.0, gt=0, description="of the timesteps that are learned from, beside the other games")
    simulator: Annotated[str, AfterValidator(_check_address)] = Field(
        "", description="HOST:PORT or unix:PATH where it is played; left out: as the others"
    )
    reward_weights: dict[str, float] = Field({}, description="weights of its reward channels; others as in the game")
    sensors: list[str] | None = Field(None, min_length=1, description="names of the sensors that count; null: all")


def _check_names(games: dict[str, GameConfig]) -> dict[str, GameConfig]:
    for name in games:
        if not name.replace("_", "").replace("-", "").isalnum():
            raise ValueError(f"the name {name!r} has other characters than letters, digits, _ and -")
    return games


def _without_null(games: Any) -> Any:
    """Leave out games whose keys are null: so an override, or a file that extends another, takes a game out."""
    return {name: one for name, one in games.items() if one is not None} if isinstance(games, dict) else games


Games = Annotated[
    dict[str, GameConfig], Field(max_length=MAX_GAMES), BeforeValidator(_without_null), AfterValidator(_check_names)
]
