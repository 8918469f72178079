"""Plot the learning curves of runs, with the original's.

python -m tools.curves RUN [RUN …] --output curves.png
"""

import argparse
from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
from matplotlib.axes import Axes

from joybridge.config.config import Config, load_config
from joybridge.config.metrics import Row, read_rows
from tools.paper.original import original_curve

PERCENT = {"click_accuracy": "click accuracy"}


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description="Plot the learning curves of runs, with the original's.")
    parser.add_argument("runs", nargs="+", type=Path, help="folders of runs")
    parser.add_argument(
        "--output", type=Path, default=Path("curves.png"), help="picture to write; default: %(default)s"
    )
    options = parser.parse_args()
    plot(options.runs, options.output)
    print(options.output)


def plot(runs: list[Path], output: Path) -> None:
    """Draw reward, and click accuracy or episode length, over timesteps for every policy of every run."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(11, 4.2), layout="constrained")
    second = ""
    for run in runs:
        config = load_config(run / "config.yaml")
        for path in sorted(run.glob("metrics-*.csv")):
            rows = [row for row in read_rows(path) if "reward" in row]
            if not rows:
                continue
            policy = path.stem.removeprefix("metrics-")
            label = f"{config.game} {config.layout}" + (f" {policy}" if config.layout == "multiagent" else "")
            second = "click_accuracy" if "click_accuracy" in rows[0] else "length"
            millions = [row["timesteps"] / 1e6 for row in rows]
            (line,) = left.plot(millions, [row["reward"] for row in rows], label=label)
            right.plot(millions, [row[second] for row in rows], color=line.get_color())
            _add_original(left, config, policy, rows, line.get_color())
    left.set(title="Reward per episode", xlabel="million timesteps")
    right.set(title=PERCENT.get(second, "episode length").capitalize(), xlabel="million timesteps")
    if second in PERCENT:
        right.set_ylim(0, 1.02)
        right.yaxis.set_major_formatter(mpl.ticker.PercentFormatter(1.0))
    for axes in (left, right):
        axes.grid(alpha=0.3)
        axes.spines[["top", "right"]].set_visible(False)
    if left.lines:
        left.legend(frameon=False)
    output.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(output, dpi=120)
    plt.close(figure)


def _add_original(axes: Axes, config: Config, policy: str, rows: list[Row], color: str) -> None:
    """Draw the original's mean and two standard deviations up to the timesteps of the run."""
    end = rows[-1]["timesteps"]
    points = [p for p in original_curve(config.game, config.layout, policy) if p.timesteps <= 1.05 * end]
    if points:
        axes.errorbar(
            [p.timesteps / 1e6 for p in points],
            [p.reward for p in points],
            [2 * p.reward_std for p in points],
            fmt="o",
            markersize=4,
            capsize=2,
            color=color,
            alpha=0.6,
            label="the original, ten runs ± 2 sd",
        )


if __name__ == "__main__":
    main()
