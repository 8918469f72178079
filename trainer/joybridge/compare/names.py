"""How runs and the files of their results are named: in one place, from a name to its text and back."""

import re
from dataclasses import dataclass
from pathlib import Path

SEED = re.compile(r"-s(\d+)(?=-|$)")  # where a run's experiment ends


@dataclass(frozen=True)
class RunName:
    """The name of a run, `EXPERIMENT-sSEED`: also the path of its folder below the folder of all runs."""

    experiment: str  # a configuration's path without ".yaml", e.g. "shooting_birds/bucket-11"
    seed: int

    def __post_init__(self) -> None:
        """Raise ValueError for an experiment whose name contains what looks like a seed."""
        if found := SEED.search(self.experiment):
            raise ValueError(
                f"experiment {self.experiment!r}: {found[0]!r} reads as a seed in the names of runs; rename the "
                "configuration"
            )

    def __str__(self) -> str:
        return f"{self.experiment}-s{self.seed}"

    @classmethod
    def parse(cls, text: str) -> "RunName":
        """Return the name that a text spells. Raises ValueError."""
        found = SEED.search(text)
        if not found or found.end() < len(text):
            raise ValueError(f"{text!r} is not the name of a run, EXPERIMENT-sSEED")
        return cls(text[: found.start()], int(found[1]))


@dataclass(frozen=True)
class ResultName:
    """The name of the CSV of one policy of a finished run.

    Its path below the folder of results is `LENGTH/EXPERIMENT-sSEED.csv`, or `LENGTH/EXPERIMENT-sSEED-POLICY.csv` where
    a run has several policies. LENGTH is in millions of timesteps, e.g. `30M`.
    """

    run: RunName
    timesteps: int
    policy: str = ""  # empty for the only policy of a run

    @property
    def path(self) -> Path:
        """Return the file's path below the folder of results."""
        millions = f"{self.timesteps / 1e6:.6f}".rstrip("0").rstrip(".")
        end = f"-{self.policy}" if self.policy else ""
        return Path(f"{millions}M", f"{self.run}{end}.csv")

    @classmethod
    def parse(cls, path: Path) -> "ResultName":
        """Return the name that a path below the folder of results spells. Raises ValueError."""
        length, _, name = path.as_posix().partition("/")
        stem, found = name.removesuffix(".csv"), SEED.search(name.removesuffix(".csv"))
        if not (re.fullmatch(r"\d+(\.\d+)?M", length) and name.endswith(".csv") and found):
            raise ValueError(f"{path} is not the path of a result, LENGTH/EXPERIMENT-sSEED[-POLICY].csv")
        run = RunName.parse(stem[: found.end()])
        return cls(run, round(float(length[:-1]) * 1e6), stem[found.end() + 1 :])


def find_results(folder: Path) -> dict[ResultName, Path]:
    """Return the results in a folder, sorted by path. Files with other names are ignored."""
    found = {}
    for path in sorted(folder.glob("*M/**/*.csv")):
        try:
            found[ResultName.parse(path.relative_to(folder))] = path
        except ValueError:
            continue
    return found
