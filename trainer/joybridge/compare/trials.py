"""The trials of a search, and the file `search.json` that keeps them: what was proposed, and what came of it.

The file is replaced as a whole before a trial begins and when one has ended, so that a search may be killed anywhere.
"""

import json
import math
from collections.abc import Sequence
from pathlib import Path
from statistics import mean
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, ValidationError

from joybridge.compare.ranges import Range
from joybridge.compare.scores import FINAL, Run
from joybridge.compare.variants import differences, in_words
from joybridge.config.errors import ConfigError
from joybridge.config.files import write_atomically
from joybridge.contract.files import read_file

LARGEST = 2**26  # bytes of the file
RUNGS = tuple(tenth / 10 for tenth in range(2, 10))  # of a run: where a hopeless trial ends


class Trial(BaseModel):
    """One training with settings that were proposed."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    settings: dict[str, str]  # by key, as they are written
    state: Literal["running", "complete", "pruned", "failed"] = "running"  # running: or it waits to go on
    timesteps: int = 0  # where it ended
    score: float | None = None  # of a complete trial
    rungs: dict[int, float] = {}  # the score so far, by timesteps, where it was judged
    reason: str = ""  # why it failed

    def overrides(self) -> list[str]:
        """Return the settings, each KEY=VALUE."""
        return [f"{key}={value}" for key, value in self.settings.items()]


class Record(BaseModel):
    """The content of the file."""

    model_config = ConfigDict(extra="forbid")

    search: dict[str, Any]  # what must stay the same: ranges, seed, length and metric
    trials: list[Trial]


def name_of(number: int) -> str:
    """Return the name of a trial's files."""
    return f"trial-{number:03}"


def read_record(path: Path, search: dict[str, Any], ranges: Sequence[Range]) -> list[Trial]:
    """Return the trials so far, none if there is no file. Failed ones are to be tried again.

    search: what is searched now. Raises ConfigError if it was another before, or if the file is damaged.
    """
    try:
        record = Record.model_validate_json(read_file(path, LARGEST))
    except FileNotFoundError:
        return []
    except (OSError, ValidationError) as error:
        what = error.errors()[0]["msg"] if isinstance(error, ValidationError) else error
        raise ConfigError(_damaged(path, str(what))) from error
    changed = list(differences(record.search, search))
    if changed:
        raise ConfigError(
            f"{path.parent} holds another search: {in_words(changed)}; repeat the command as it was, or name another "
            "folder with --output"
        )
    for number, trial in enumerate(record.trials):
        outside = [key for key, value in trial.settings.items() if key not in search["ranges"]]
        outside += [each.key for each in ranges if each.read(trial.settings.get(each.key, "")) is None]
        if outside or (trial.state == "complete") != (trial.score is not None):
            what = (
                f"its {outside[0]} is not in the range" if outside else f"it is {trial.state} with a score or without"
            )
            raise ConfigError(_damaged(path, f"{name_of(number)}: {what}"))
    return [Trial(settings=trial.settings) if trial.state == "failed" else trial for trial in record.trials]


def write_record(path: Path, search: dict[str, Any], trials: Sequence[Trial]) -> None:
    """Replace the file. Raises StorageError."""
    text = json.dumps({"search": search, "trials": [trial.model_dump() for trial in trials]}, indent=1)
    write_atomically(path, f"{text}\n".encode())


def best_trial(trials: Sequence[Trial]) -> int | None:
    """Return the number of the complete trial with the highest score, the first of equals; None if there is none."""
    scores = {number: trial.score for number, trial in enumerate(trials) if trial.score is not None}
    return max(scores, key=lambda number: (scores[number], -number), default=None)


def rungs(end: int, interval: int) -> list[int]:
    """Return the timesteps where trials are compared: ends of rows of metrics before the end of a run."""
    marks = (math.ceil(share * end / interval) * interval for share in RUNGS)
    return [mark for mark in dict.fromkeys(marks) if mark < end]


def until(run: Run, timesteps: int, interval: int) -> Run | None:
    """Return the part of a run up to the row of metrics at `timesteps`; None if it has no score by then."""
    points = tuple(point for point in run.points if point.timesteps // interval <= timesteps // interval)
    return Run(run.seed, points) if points else None


def score_so_far(part: Run, end: int, interval: int) -> float:
    """Return the mean of as many rows, the last ones of a part, as make the score of a whole run."""
    rows = math.ceil(FINAL * (end // interval))
    return mean(point.value for point in part.points[-rows:])


def _damaged(path: Path, what: str) -> str:
    return (
        f"{path} is damaged ({what}); move it away, and repeat the command: the same trials are proposed again, and "
        "those whose runs are here need no training"
    )
