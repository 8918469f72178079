"""Results of tests, kept in the folder of each run.

So a test that was interrupted goes on where it was, and one of another metric plays nothing.
"""

from pathlib import Path
from typing import NamedTuple

from pydantic import TypeAdapter

from joybridge.compare.made_with import MadeWith
from joybridge.config.files import write_atomically
from joybridge.config.json_files import read_json
from joybridge.config.metrics import Row

FILE = "tests.json"  # in the folder of a run
MAX_BYTES = 2**24  # of it


class PlayedTest(NamedTuple):
    """All that the result of a test depends on, but for the run."""

    settings: list[str]  # overrides
    episodes: int
    deterministic: bool
    seed: int
    timesteps: int  # of the checkpoint that plays
    played_with: MadeWith


class Reached(NamedTuple):
    """What a policy has reached."""

    episodes: int
    means: Row


Results = list[tuple[PlayedTest, dict[str, Reached]]]  # by policy
RESULTS = TypeAdapter(Results)


def find_result(run: Path, test: PlayedTest) -> dict[str, Reached] | None:
    """Return what the policies of a run have reached in a test; None if it is not kept. Raises ConfigError."""
    return next((reached for played, reached in _read(run) if played == test), None)


def keep_result(run: Path, test: PlayedTest, reached: dict[str, Reached]) -> None:
    """Write what the policies of a run have reached in a test. Raises ConfigError and StorageError."""
    write_atomically(run / FILE, RESULTS.dump_json([*_read(run), (test, reached)], indent=1))


def _read(run: Path) -> Results:
    return read_json(run / FILE, RESULTS, MAX_BYTES, "delete it, and its tests are played again") or []
