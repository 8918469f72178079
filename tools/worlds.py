r"""Pages about foes and cameras, from the runs of two comparisons.

python -m tools.worlds foes FOLDER       writes results/foes, from runs of
    joybridge compare shooting_birds/fast --layouts bucket-11 bucket-3 hybrid multiagent threshold-0.0 \
        --set options.birds=straight,dodging,blinking --seeds 3 --output FOLDER total_timesteps=3000000
python -m tools.worlds cameras FOLDER    writes results/cameras, from runs of
    joybridge compare shooting_birds/fast --layouts bucket-11 hybrid multiagent \
        --set options.camera=edge,axis,drag --seeds 3 --output FOLDER/rays total_timesteps=3000000 stratify_by=null
    and of the same with --output FOLDER/birds and
        options.nearest_birds=shown options.hints=on options.locomotion=axes
    and of the same with --output FOLDER/longer and total_timesteps=12000000

Without FOLDER, or what it lacks, the page is written again from the metrics in its own folder.
"""

import argparse
import shutil
from collections.abc import Callable, Mapping
from pathlib import Path
from statistics import fmean
from textwrap import fill
from typing import NamedTuple

import numpy as np
from scipy.stats import kendalltau

from joybridge.compare.estimators import estimate, interquartile_mean
from joybridge.compare.page_parts import table
from joybridge.compare.table import TABLE, read_table
from joybridge.config.metrics import Row, numbers
from joybridge.contract.spec import choose_options
from joybridge.contract.tensors import Array
from joybridge.games.shooting_birds import script
from joybridge.games.shooting_birds.game import ShootingBirds
from tools.paper.original import original_ends
from tools.paper.runs import main_policy

RESULTS = Path(__file__).parents[1] / "results"
SETTINGS = "the settings of `shooting_birds/fast`, the original levels and {timesteps:,} timesteps"
ORIGIN = (
    "`python -m tools.worlds {page}` in a checkout writes this page; its `--help` has the command of the runs, and "
    "runs.csv.xz their metrics."
)
WIDTH = 118  # of the lines of a page
DRAWS = 10_000  # of the bootstrap of a rank correlation
EPISODES = 210  # of the scripted player
CAMERAS = {  # comparisons of the page about cameras
    "birds": "Who sees where the nearest birds on the screen are, how they fly, and how many are beside it (the "
    "options `nearest_birds` and `hints`), and moves the crosshair along x and y",
    "longer": "The same",
    "rays": "Who sees rays, as in the paper's game, and moves the crosshair by an angle and a speed",
}


class Scores(NamedTuple):
    """The last rows of the runs of one layout in one world."""

    rewards: Array  # [seeds]
    rows: list[Row]  # of metrics

    def text(self, scale: float = 1.0, digits: int = 1) -> str:
        """Return the interquartile mean of the rewards, divided by `scale`, with its 95 % interval and the runs."""
        rewards = self.rewards / scale
        found = estimate(interquartile_mean, rewards[:, None])
        each = ", ".join(f"{reward:.{digits}f}" for reward in rewards)
        return f"{found.value:.{digits}f} [{found.low:.{digits}f}, {found.high:.{digits}f}] ({each})"

    def mean(self, metric: str) -> float:
        """Return the mean of a metric over the runs."""
        return float(np.mean([row[metric] for row in self.rows]))


Worlds = dict[str, dict[str, Scores]]  # by world and layout


def read_scores(folder: Path) -> tuple[Worlds, int]:
    """Return the scores of the runs in a table, and their timesteps. multiagent: of the agent that clicks."""
    found: dict[str, dict[str, list[Row]]] = {}
    lengths = set()
    for name, rows in read_table(folder).items():
        if name.policy == "axes":
            continue
        layout, _, setting = name.run.experiment.partition("-options.")
        found.setdefault(setting.partition("=")[2], {}).setdefault(layout, []).append(numbers(rows)[-1])
        lengths.add(name.timesteps)
    (timesteps,) = lengths
    worlds = {
        world: {name: Scores(np.array([row["reward"] for row in rows], float), rows) for name, rows in layouts.items()}
        for world, layouts in found.items()
    }
    return worlds, timesteps


def paper() -> dict[str, float]:
    """Return the original's mean reward after 30 million timesteps, by layout."""
    ends = {
        layout: original_ends("shooting_birds", layout, main_policy(layout))
        for layout in ("bucket-11", "multiagent", "bucket-3", "threshold-0.0")
    }
    return {layout: fmean(end.reward) for layout, end in ends.items() if end is not None}


def agreement(layouts: Mapping[str, Scores]) -> str:
    """Return the rank correlation with the paper's rewards, and its 95 % interval over the choice of the runs."""
    theirs = paper()
    rewards, reached = [layouts[name].rewards for name in theirs], list(theirs.values())
    rng = np.random.default_rng(0)
    drawn = [
        kendalltau([rng.choice(each, len(each)).mean() for each in rewards], reached).statistic for _ in range(DRAWS)
    ]
    low, high = np.percentile(drawn, [2.5, 97.5])
    return f"{kendalltau([each.mean() for each in rewards], reached).statistic:.2f} [{low:.2f}, {high:.2f}]"


def foes(folder: Path) -> str:
    """Return the page about foes."""
    worlds, timesteps = read_scores(folder)
    names = ["straight", "dodging", "blinking"]
    layouts = sorted(worlds["straight"], key=lambda name: -worlds["straight"][name].rewards.mean())
    rows = [[f"`{name}`", *(worlds[world][name].text() for world in names)] for name in layouts]
    orders = [", ".join(sorted(worlds[w], key=lambda name: -worlds[w][name].rewards.mean())) for w in names]
    compared = [[world, order, agreement(worlds[world])] for world, order in zip(names, orders, strict=True)]
    introduction = (
        f"Five layouts with {SETTINGS.format(timesteps=timesteps)}. Reward of the last 600,000 timesteps: the "
        "interquartile mean of the runs with its 95 % bootstrap interval, and each run, seed by seed. With three runs "
        "such intervals are too narrow. The settings were chosen for `bucket-7` and birds that fly straight; nothing "
        f"was chosen for a layout or a bird. {ORIGIN.format(page='foes')}"
    )
    known = ", ".join(f"`{name}` {value:.1f}" for name, value in paper().items())
    correlation = (
        f"Kendall's rank correlation τ between these rewards and the paper's after 30 million timesteps ({known}; "
        "`hybrid` is not in the paper). Its interval is that of a bootstrap over the runs."
    )
    return page(
        "Which layout hits birds that dodge?",
        fill(introduction, WIDTH),
        table(["layout", *names], rows),
        fill(correlation, WIDTH),
        table(["birds", "from the best to the worst", "τ"], compared),
    )


def travel(camera: str) -> float:
    """Return the mean reward of the scripted player that moves a camera."""
    options = choose_options(ShootingBirds.options, {"camera": camera, "locomotion": "axes"}, "shooting_birds")
    return float(script.play(ShootingBirds(options, {}, EPISODES, 0, 0)).mean())


def cameras(folder: Path) -> str:
    """Return the page about cameras."""
    scripted = {camera: travel(camera) for camera in ("edge", "axis", "drag")}
    parts = []
    for part, who in CAMERAS.items():
        worlds, timesteps = read_scores(folder / part)
        rows = [
            [camera, f"{reward:.1f}", f"`{name}`", scores.text(reward, 2), f"{scores.mean('empty_screen'):.1%}"]
            for camera, reward in scripted.items()
            for name, scores in worlds[camera].items()
        ]
        parts += [
            fill(f"{who}, after {timesteps:,} timesteps:", WIDTH),
            table(["camera", "scripted player", "layout", "share of it", "empty screen"], rows),
        ]
    introduction = (
        "A field three screens wide, with the settings of `shooting_birds/fast`. The share is the reward of the last "
        "600,000 timesteps, divided by that of a scripted player that knows where all birds are and travels with the "
        f"same camera ({EPISODES} episodes): interquartile mean of the runs with its 95 % bootstrap interval, and each "
        f"run. The empty screen is the part of the time without a bird on the screen. {ORIGIN.format(page='cameras')}"
    )
    return page("Which camera can be learned?", fill(introduction, WIDTH), *parts)


def page(title: str, *parts: str) -> str:
    """Return a page in Markdown."""
    return "\n\n".join([f"# {title}", *parts]) + "\n"


# How each page is written, and the folders of its comparisons, below that of the page.
PAGES: dict[str, tuple[Callable[[Path], str], list[str]]] = {"foes": (foes, ["."]), "cameras": (cameras, [*CAMERAS])}


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("page", choices=PAGES)
    parser.add_argument("folder", type=Path, nargs="?", help="of the runs of `joybridge compare`")
    arguments = parser.parse_args()
    folder, (write, parts) = RESULTS / arguments.page, PAGES[arguments.page]
    for part in parts:
        (folder / part).mkdir(parents=True, exist_ok=True)
        if arguments.folder and (arguments.folder / part / TABLE).exists():
            shutil.copy(arguments.folder / part / TABLE, folder / part / TABLE)
    (folder / "README.md").write_text(write(folder), encoding="utf-8")


if __name__ == "__main__":
    main()
