"""How well policies play levels that they have not seen: trains on sets of levels, writes results/generalization.md.

python -m tools.generalization FOLDER [--levels 7 50 200 1000 1000000] [--seeds 3] [--timesteps 18000000]

A run for each number of levels of the training set and each seed is trained in the folder with shooting_birds/fast, and
played on its own levels and on 1,000 levels of the test set. Finished parts are not repeated. Scores are shares of what
the scripted player earns on the same levels, so that easy and hard ones can be compared.
"""

import argparse
import json
import subprocess
import sys
from pathlib import Path

import numpy as np

from joybridge.compare.estimators import Estimate, estimate, interquartile_mean
from joybridge.contract.spec import choose_options
from joybridge.games.level_sets import SETS
from joybridge.games.shooting_birds import script
from joybridge.games.shooting_birds.game import ShootingBirds

UNSEEN = 1000  # levels of the test set
EPISODES = 600  # of an evaluation, and of the scripted player
PAGE = Path(__file__).parents[1] / "results" / "generalization.md"
CONFIG = "shooting_birds/fast"
OPTIONS = ["stratify_by=null", "options.levels=generated"]


def joybridge(*arguments: str) -> str:
    """Run the command and return what it prints."""
    command = [sys.executable, "-m", "joybridge", *arguments]
    return subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout


def reward(run: Path, first: int, count: int) -> float:
    """Return the mean reward of a run's policy on some levels; it is kept in the run's folder."""
    known = run / f"reward-{first}-{count}.json"
    if not known.exists():
        levels = [f"parameters.first_level={first}", f"parameters.level_count={count}"]
        known.write_text(joybridge("evaluate", str(run), *levels, "--episodes", str(EPISODES), "--json"))
    (policy,) = json.loads(known.read_text().splitlines()[-1]).values()
    return float(policy["means"]["reward"])


def scripted(first: int, count: int) -> float:
    """Return the mean reward of the scripted player on some levels."""
    options = choose_options(ShootingBirds.options, {"levels": "generated", "locomotion": "axes"}, "shooting_birds")
    game = ShootingBirds(options, {"first_level": first, "level_count": count}, EPISODES, 0, 0)
    return float(script.play(game).mean())


def trained(folder: Path, count: int, seed: int, timesteps: int) -> Path:
    """Return the folder of a run on so many levels, which is trained now if it is not finished."""
    run = folder / f"levels-{count}-{seed}"
    settings = [f"parameters.level_count={count}", f"seed={seed}", f"total_timesteps={timesteps}"]
    begun = run / "config.yaml"
    if not (run / "finished").exists():
        how = ["--resume"] if begun.exists() else []
        joybridge("train", CONFIG, "--run", str(run), *how, *([] if how else [*OPTIONS, *settings]))
        (run / "finished").touch()
    return run


def cell(found: Estimate, runs: int) -> str:
    """Return a share with its interval; a single run has none."""
    return f"{found.value:.2f}" + (f" ({found.low:.2f} … {found.high:.2f})" if runs > 1 else "")


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description="Train on some levels, play others.")
    parser.add_argument("folder", type=Path, help="of the runs")
    parser.add_argument("--levels", type=int, nargs="+", default=[7, 50, 200, 1000, 1_000_000])
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--timesteps", type=int, default=18_000_000)
    arguments = parser.parse_args()
    first = SETS["test"].start
    unseen = scripted(first, UNSEEN)
    rows = []
    for count in arguments.levels:
        runs = [trained(arguments.folder, count, seed, arguments.timesteps) for seed in range(1, arguments.seeds + 1)]
        own = scripted(0, count)
        seen = np.array([[reward(run, 0, count) / own] for run in runs])
        new = np.array([[reward(run, first, UNSEEN) / unseen] for run in runs])
        cells = [cell(estimate(interquartile_mean, scores), len(runs)) for scores in (seen, new)]
        rows.append(f"| {count:,} | {cells[0]} | {cells[1]} |")
    PAGE.write_text(
        "# Levels that were not seen\n\n"
        f"Policies of `{CONFIG}` after {arguments.timesteps:,} timesteps on generated levels of the training set, and\n"
        f"what they earn on these levels and on {UNSEEN:,} levels of the test set, as a share of what the scripted\n"
        f"player earns on the same levels ({unseen:.0f} on the unseen ones). Runs per row: {arguments.seeds}; of\n"
        "several, the interquartile mean with its 95 % interval. Written by `python -m tools.generalization`.\n\n"
        "| levels trained on | on these levels | on unseen levels |\n|---:|---:|---:|\n" + "\n".join(rows) + "\n"
    )


if __name__ == "__main__":
    main()
