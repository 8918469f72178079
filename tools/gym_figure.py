"""Draw the learning curves in results/gym, a panel per configuration, into results/pictures/gym.png.

python -m tools.gym_figure
"""

import re
from collections import defaultdict
from math import ceil
from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt

from joybridge.config.config import load_config
from joybridge.config.metrics import read_rows

ROOT = Path(__file__).resolve().parents[1]
PICTURE = ROOT / "results/pictures/gym.png"
COLUMNS = 3


def main() -> None:
    """Draw the figure."""
    seeds: dict[str, list[Path]] = defaultdict(list)  # of each configuration, a file per seed and policy
    for path in sorted((ROOT / "results/gym").glob("*.csv")):
        seeds[re.sub(r"-s\d+.*", "", path.stem)].append(path)
    rows = ceil(len(seeds) / COLUMNS)
    figure, panels = plt.subplots(rows, COLUMNS, figsize=(11, 2.7 * rows), layout="constrained", squeeze=False)
    for panel in panels.flat[len(seeds) :]:
        panel.set_visible(False)
    for panel, (name, paths) in zip(panels.flat, seeds.items(), strict=False):
        config = load_config(ROOT / f"configs/gym/{name}.yaml")
        for path in paths:
            points = [(row["timesteps"] / 1e6, row["reward"]) for row in read_rows(path) if "reward" in row]
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
