"""Finished matches: a log with a row for each, and what their pairs and seats say."""

import json
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, NamedTuple

import numpy as np
from filelock import FileLock
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from joybridge.config.errors import CheckpointError
from joybridge.config.files import storing, write_atomically
from joybridge.config.json_files import reason_of
from joybridge.contract.files import read_file
from joybridge.contract.tensors import Array

LOG = "matches.jsonl"
MAX_BYTES = 2**30  # of a log


class Match(BaseModel):
    """Who held the seats of a match, and in which places they ended."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    players: tuple[str, ...] = Field(min_length=2)  # by seat
    places: tuple[Annotated[float, Field(allow_inf_nan=False)], ...]  # by seat; the lowest is the best
    seed: int = Field(0, ge=0)  # of the tournament
    arena: int = Field(0, ge=0)
    episode: int = Field(0, ge=0)  # of the arena
    settings: str = ""  # of the game that differ from the training, as on the command line

    @model_validator(mode="after")
    def _check(self) -> "Match":
        if len(self.places) != len(self.players):
            raise ValueError(f"{len(self.players)} players have {len(self.places)} places")
        return self


class Payoff(NamedTuple):
    """How often each of some players was ahead of each other; a shared place counts one half."""

    players: list[str]
    ahead: Array  # [players, players]
    met: Array  # [players, players]: how often the two were in one match

    @property
    def share(self) -> Array:
        """The share of meetings in which the row was ahead of the column, NaN where there was none."""
        with np.errstate(invalid="ignore"):
            return self.ahead / self.met


def read_matches(folder: Path) -> list[Match]:
    """Return all matches in the log of a folder, none if there is no log. Raises CheckpointError."""
    path = folder / LOG
    try:
        lines = read_file(path, MAX_BYTES).splitlines()
    except FileNotFoundError:
        return []
    except OSError as error:
        raise CheckpointError(f"{path} cannot be read: {error.strerror or error}") from error
    matches = []
    for number, line in enumerate(lines, 1):
        try:
            matches.append(Match.model_validate_json(line))
        except ValidationError as error:
            raise CheckpointError(f"{path}, line {number}, is no match: {reason_of(error)}; delete it") from None
    return matches


@contextmanager
def locked_log(folder: Path) -> Iterator[None]:
    """Let nobody else change the log of a folder, which is made if it does not exist. Raises StorageError."""
    with storing(folder):
        folder.mkdir(parents=True, exist_ok=True)
        lock = FileLock(folder / "matches.lock")
        lock.acquire()
    try:
        yield
    finally:
        lock.release()


def write_matches(folder: Path, matches: Iterable[Match]) -> None:
    """Replace the log of a folder. Raises StorageError."""
    lines = [json.dumps(match.model_dump(), ensure_ascii=False) + "\n" for match in matches]
    write_atomically(folder / LOG, "".join(lines).encode())


def payoff(matches: Sequence[Match], players: Sequence[str]) -> Payoff:
    """Return who was ahead of whom, of some players. A player that met itself is left out."""
    index = {player: number for number, player in enumerate(players)}
    ahead, met = np.zeros((len(index), len(index))), np.zeros((len(index), len(index)))
    for match in matches:
        seats = [(index[p], place) for p, place in zip(match.players, match.places, strict=True) if p in index]
        for one, place in seats:
            for other, theirs in seats:
                if one != other:
                    ahead[one, other] += (place < theirs) + 0.5 * (place == theirs)
                    met[one, other] += 1
    return Payoff(list(players), ahead, met)


def seat_shares(matches: Sequence[Match]) -> Array:
    """Return the share of wins of each seat, [seats]; those who share the first place share the win."""
    seats = len(matches[0].places)
    places = np.array([match.places for match in matches if len(match.places) == seats])
    first = places == places.min(axis=1, keepdims=True)
    shares: Array = (first / first.sum(axis=1, keepdims=True)).mean(axis=0)
    return shares
