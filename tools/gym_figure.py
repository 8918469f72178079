"""Draw the learning curves in results/gym, a panel per configuration, into results/pictures/gym.png.

python -m tools.gym_figure
"""

import argparse
from collections import defaultdict
from math import ceil
from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt

from joybridge.compare import read_table
from joybridge.config.config import load_config
from joybridge.config.metrics import Row, numbers

ROOT = Path(__file__).resolve().parents[1]
PICTURE = ROOT / "results/pictures/gym.png"
COLUMNS = 3


def main() -> None:
    """Draw the figure."""
    argparse.ArgumentParser(prog="python -m tools.gym_figure", description=__doc__.splitlines()[0]).parse_args()
    seeds: dict[str, list[list[Row]]] = defaultdict(list)  # of each configuration, the rows of each seed and policy
    for name, cells in sorted(read_table(ROOT / "results/gym").items(), key=lambda item: str(item[0].run)):
        seeds[name.run.experiment].append(numbers(cells))
    rows = ceil(len(seeds) / COLUMNS)
    figure, panels = plt.subplots(rows, COLUMNS, figsize=(11, 2.7 * rows), layout="constrained", squeeze=False)
    for panel in panels.flat[len(seeds) :]:
        panel.set_visible(False)
    for panel, (experiment, runs) in zip(panels.flat, seeds.items(), strict=False):
        config = load_config(ROOT / f"configs/gym/{experiment}.yaml")
        for run in runs:
            points = [(row["timesteps"] / 1e6, row["reward"]) for row in run if "reward" in row]
            panel.plot(*zip(*points, strict=True))
        panel.set_title(f"{config.game}, {config.layout}", fontsize=10)
        panel.grid(alpha=0.3)
        panel.spines[["top", "right"]].set_visible(False)
    figure.supxlabel("million timesteps", fontsize=10)
    figure.supylabel("reward per episode", fontsize=10)
    figure.savefig(PICTURE, dpi=100)
    print(PICTURE.relative_to(ROOT))


if __name__ == "__main__":
    main()
