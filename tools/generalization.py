"""How well policies play levels that they have not seen: trains on sets of levels, writes results/generalization.

python -m tools.generalization FOLDER [--levels 7 50 200 1000 1000000] [--seeds 3] [--timesteps 18000000]

A run for each number of levels of the training set and each seed is trained in the folder with shooting_birds/fast, and
played on its own levels, on 1,000 levels of the test set, and on the seven levels of the paper; CHANGES are trained on
50 levels. Finished parts are not repeated. Scores are shares of what the scripted player earns on the same levels, so
that easy and hard ones can be compared.
"""

import argparse
import csv
import json
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from joybridge.compare.estimators import estimate, interquartile_mean
from joybridge.compare.page_parts import table
from joybridge.contract.spec import choose_options
from joybridge.games.level_sets import SETS
from joybridge.games.shooting_birds import script
from joybridge.games.shooting_birds.game import ShootingBirds

UNSEEN = 1000  # levels of the test set
EPISODES = 600  # of an evaluation, and of the scripted player
PAGE = Path(__file__).parents[1] / "results" / "generalization" / "README.md"
CONFIG = "shooting_birds/fast"
GENERATED = ["stratify_by=null", "options.levels=generated"]
PAPER = ["options.levels=original"]
CHANGES = {  # of runs on 50 levels
    "three times the entropy bonus": ["policy.entropy_coef=0.03"],
    "weight decay of 0.1": ["policy.weight_decay=0.1"],
    "actor and critic apart": ["policy.shared_body=false"],
}
CHANGED = 50


def joybridge(*arguments: str) -> str:
    """Run the command and return what it prints."""
    command = [sys.executable, "-m", "joybridge", *arguments]
    return subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout


def levels(first: int, count: int) -> list[str]:
    """Return the settings that choose some levels."""
    return [f"parameters.first_level={first}", f"parameters.level_count={count}"]


def reward(run: Path, name: str, settings: Sequence[str]) -> float:
    """Return the mean reward of a run's policy under some settings; it is kept in the run's folder under a name."""
    known = run / f"reward-{name}.json"
    if not known.exists():
        known.write_text(joybridge("evaluate", str(run), *settings, "--episodes", str(EPISODES), "--json"))
    return means_and_episodes(known)["reward"]


def scripted(first: int, count: int) -> float:
    """Return the mean reward of the scripted player on some levels."""
    options = choose_options(ShootingBirds.options, {"levels": "generated", "locomotion": "axes"}, "shooting_birds")
    game = ShootingBirds(options, {"first_level": first, "level_count": count}, EPISODES, 0, 0)
    return float(script.play(game).mean())


def trained(run: Path, settings: Sequence[str]) -> Path:
    """Return the folder of a run, which is trained now if it is not finished."""
    if not (run / "finished").exists():
        begun = (run / "config.yaml").exists()
        joybridge("train", CONFIG, "--run", str(run), *(["--resume"] if begun else settings))
        (run / "finished").touch()
    return run


def cell(scores: Sequence[float]) -> str:
    """Return the interquartile mean of some runs with its interval; a single run has none."""
    found = estimate(interquartile_mean, np.array(scores)[:, None])
    return f"{found.value:.2f}" + (f" [{found.low:.2f}, {found.high:.2f}]" if len(scores) > 1 else "")


def write_rewards(folder: Path) -> None:
    """Write a row for each evaluation of the runs in a folder beside the page."""
    rows = [
        {"run": path.parent.name, "levels": path.stem.removeprefix("reward-"), **means_and_episodes(path)}
        for path in sorted(folder.glob("*/reward-*.json"))
    ]
    with (PAGE.parent / "rewards.csv").open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


def means_and_episodes(evaluation: Path) -> dict[str, float]:
    """Return the mean reward of an evaluation, and of how many episodes it is."""
    (policy,) = json.loads(evaluation.read_text().splitlines()[-1]).values()
    return {"reward": policy["means"]["reward"], "episodes": policy["episodes"]}


class Study:
    """The runs in a folder."""

    def __init__(self, folder: Path, seeds: int, timesteps: int) -> None:
        """Train nothing yet."""
        self.folder, self.seeds, self.timesteps = folder, range(1, seeds + 1), timesteps
        self.first = SETS["test"].start
        self.unseen = scripted(self.first, UNSEEN)

    def runs(self, name: str, settings: Sequence[str]) -> list[Path]:
        """Return the runs of all seeds, trained."""
        end = f"total_timesteps={self.timesteps}"
        return [trained(self.folder / f"{name}-{seed}", [*settings, f"seed={seed}", end]) for seed in self.seeds]

    def shares(self, runs: Sequence[Path], count: int) -> list[str]:
        """Return the cells of runs on so many levels: their score on these, and on levels that they have not seen."""
        own = scripted(0, count)
        seen = [reward(run, f"0-{count}", levels(0, count)) / own for run in runs]
        new = [reward(run, f"{self.first}-{UNSEEN}", levels(self.first, UNSEEN)) / self.unseen for run in runs]
        gaps = [1 - after / before for before, after in zip(seen, new, strict=True)]
        return [cell(seen), cell(new), cell(gaps)]

    def rewards_on_the_papers_levels(self, runs: Sequence[Path]) -> str:
        """Return the cell of the rewards of runs on the seven levels of the paper."""
        found = estimate(interquartile_mean, np.array([[reward(run, "paper", PAPER)] for run in runs]))
        return f"{found.value:.0f}" + (f" [{found.low:.0f}, {found.high:.0f}]" if len(runs) > 1 else "")


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description="Train on some levels, play others.")
    parser.add_argument("folder", type=Path, help="of the runs")
    parser.add_argument("--levels", type=int, nargs="+", default=[7, CHANGED, 200, 1000, 1_000_000])
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--timesteps", type=int, default=18_000_000)
    arguments = parser.parse_args()
    study = Study(arguments.folder, arguments.seeds, arguments.timesteps)
    rows = []
    for count in arguments.levels:
        runs = study.runs(f"levels-{count}", [*GENERATED, f"parameters.level_count={count}"])
        rows.append([f"{count:,}", *study.shares(runs, count), study.rewards_on_the_papers_levels(runs)])
    specialists = study.rewards_on_the_papers_levels(study.runs("paper", []))
    changed = []
    for name, change in {"none": [], **CHANGES}.items():
        base = f"levels-{CHANGED}" + (f"-{name.replace(' ', '-')}" if change else "")
        runs = study.runs(base, [*GENERATED, f"parameters.level_count={CHANGED}", *change])
        changed.append([name, *study.shares(runs, CHANGED)])
    head = ["on these levels", "on unseen levels", "gap"]
    write_rewards(arguments.folder)
    PAGE.write_text(
        "# Levels that were not seen\n\n"
        f"Policies of `{CONFIG}` after {arguments.timesteps:,} timesteps on generated levels of the training set, and\n"
        f"what they earn on these levels and on {UNSEEN:,} levels of the test set, as a share of what the scripted\n"
        f"player earns on the same levels ({study.unseen:.0f} on the unseen ones). The gap is what is lost of the\n"
        f"first share. Each policy samples its actions in {EPISODES} episodes of each set. Runs per row:\n"
        f"{arguments.seeds}; the interquartile mean with its 95 % bootstrap interval. Written by\n"
        "`python -m tools.generalization` in a checkout; rewards.csv has the mean reward of every run in every set.\n\n"
        + table(["levels trained on", *head, "reward on the paper's seven"], rows)
        + f"\n\nPolicies that were trained on the paper's seven levels for as long earn {specialists} there.\n\n"
        f"## Changes, on {CHANGED} levels\n\n" + table(["change", *head], changed) + "\n",
        encoding="utf-8",
    )


if __name__ == "__main__":
    main()
