"""How runs and their results are named: in one place, from a name to its text and back."""

import hashlib
import re
from dataclasses import dataclass

MAX_MARK_CHARS = 120
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
    """The name of what one policy of a finished run has reached.

    It is written `LENGTH/EXPERIMENT-sSEED`, or `LENGTH/EXPERIMENT-sSEED-POLICY` where a run has several policies.
    LENGTH is in millions of timesteps, e.g. `30M`.
    """

    run: RunName
    timesteps: int
    policy: str = ""  # empty for the only policy of a run

    def __str__(self) -> str:
        millions = f"{self.timesteps / 1e6:.6f}".rstrip("0").rstrip(".")
        end = f"-{self.policy}" if self.policy else ""
        return f"{millions}M/{self.run}{end}"


def file_name(label: str) -> str:
    """Return the name of the files of something that is called so for people."""
    return re.sub(r"[^\w.+=-]+", "_", label.replace(", ", "-")).strip("_")


def page_mark(metric: str, *others: str | None) -> str:
    """Return what the names of the files of a page end with, so that pages of one comparison stand side by side.

    It is empty for the reward alone. others: what else makes a page another one, as the behavior does; None: nothing.
    """
    parts = ["" if metric == "reward" else metric, *others]
    mark = "".join(f"-{file_name(part)}" for part in parts if part)
    if len(mark) > MAX_MARK_CHARS:
        return f"{mark[:MAX_MARK_CHARS]}-{hashlib.sha256(mark.encode()).hexdigest()[:8]}"
    return mark
