"""The paper's figures 11 to 14 with our runs and the original's ten."""

from collections.abc import Mapping
from itertools import groupby
from pathlib import Path
from typing import Any

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import EngFormatter, FixedLocator, FuncFormatter, NullLocator, PercentFormatter

from joybridge.compare import pictures
from tools.paper.original import TIMESTEPS_PER_STEP, original_curve, original_ends, paper_figures
from tools.paper.runs import COMPLETE, GAMES, LAYOUTS, MARK, Experiment, Results, main_policy

TITLES = {"shooting_birds": "Shooting Birds", "beastly_rivals": "Beastly Rivals"}
COLORS = {
    "bucket-3": "#56B4E9",
    "bucket-11": "#0072B2",
    "bucket-41": "#14315C",
    "threshold-0.0": "#D55E00",
    "threshold-0.1": "#E6A100",
    "threshold-0.5": "#8C564B",
    "multiagent": "#009E73",
    "hybrid": "#B0479A",
}
BEST = {"shooting_birds": "bucket-11", "beastly_rivals": "bucket-3"}  # the bucket whose networks were published
SECOND = {"shooting_birds": "click_accuracy", "beastly_rivals": "length"}  # the second panel of each game
LIMITS = {  # of the y axes; the first rewards of some layouts are far below
    ("shooting_birds", "reward"): (-80, 155),
    ("shooting_birds", "click_accuracy"): (0, 1.03),
    ("beastly_rivals", "reward"): (-5, 122),
    ("beastly_rivals", "length"): (0, 2020),
}
LABELS = {
    "reward": "reward per episode",
    "click_accuracy": "click accuracy",
    "length": "survival, decisions of 0.12 s",
}
STYLE: Any = {
    "font.size": 10,
    "axes.grid": True,
    "grid.alpha": 0.25,
    "grid.linewidth": 0.6,
    "axes.titleweight": "bold",
    "axes.spines.right": False,
    "legend.frameon": False,
    "axes.edgecolor": "#666666",
    "figure.facecolor": "white",
}


def draw_figures(results: Results, folder: Path) -> list[Path]:
    """Write the four figures to `folder` and return their paths."""
    folder.mkdir(parents=True, exist_ok=True)
    thresholds = tuple(layout for layout in LAYOUTS if layout.startswith("threshold"))
    buckets = ("bucket-3", "bucket-11", "bucket-41")
    approaches = {game: (BEST[game], "threshold-0.0", "multiagent", "hybrid") for game in GAMES}
    with plt.rc_context(STYLE):
        return [
            _draw_curves(results, dict.fromkeys(GAMES, thresholds), folder / "figure-11-threshold.png"),
            _draw_curves(results, dict.fromkeys(GAMES, buckets), folder / "figure-12-bucket.png"),
            _draw_curves(results, approaches, folder / "figure-13-approaches.png"),
            _draw_hours(results, folder / "figure-14-training-time.png"),
        ]


def _draw_curves(results: Results, layouts: Mapping[str, tuple[str, ...]], path: Path) -> Path:
    """Draw reward and a second metric of some layouts of each game over timesteps."""
    figure, panels = plt.subplots(2, 2, figsize=(11, 7.4), layout="constrained", sharex=True)
    for row, (game, chosen) in zip(panels, layouts.items(), strict=True):
        for axes, key in zip(row, ("reward", SECOND[game]), strict=True):
            for layout in chosen:
                _add_original(axes, game, layout, key)
                if (game, layout, main_policy(layout)) in results:
                    _add_ours(axes, results[game, layout, main_policy(layout)], key)
            _set_axes(axes, game, key)
        row[0].legend(handles=[Line2D([], [], color=COLORS[name], lw=2.2, label=name) for name in chosen], loc="best")
    for axes in panels[0]:
        _add_steps(axes)
    for axes in panels[1]:
        axes.set_xlabel("million timesteps")
    grey = "#555555"
    figure.legend(
        handles=[
            Line2D([], [], color=grey, lw=2, label="ours, mean over runs"),
            Patch(color=grey, alpha=0.35, label="ours, lowest to highest run"),
            Line2D([], [], color=grey, lw=1.1, ls="--", label="the original, mean of ten runs"),
            Patch(color=grey, alpha=0.13, label="the original, ± 2 sd"),
            Line2D([], [], color=grey, marker="D", mfc="white", ls="", label="printed in the paper"),
        ],
        loc="outside lower center",
        ncols=5,
        fontsize=9,
    )
    return save_figure(figure, path)


def _add_original(axes: Axes, game: str, layout: str, key: str) -> None:
    """Draw the original's mean and two standard deviations, and the last value as printed in the paper."""
    points, color = original_curve(game, layout, main_policy(layout)), COLORS[layout]
    if points and key != "click_accuracy":  # there are no logs of it
        millions = [point.timesteps / 1e6 for point in points]
        means = np.array([getattr(point, key) for point in points])
        band = 2 * np.array([getattr(point, f"{key}_std") for point in points])
        axes.plot(millions, means, color=color, lw=1.1, ls="--")
        axes.fill_between(millions, means - band, means + band, color=color, alpha=0.13, lw=0)
    printed = paper_figures(game, layout).get({"click_accuracy": "accuracy"}.get(key, key))
    if printed:
        axes.plot(COMPLETE / 1e6, printed, "D", color=color, mfc="white", ms=5, clip_on=False, zorder=5)


def _add_ours(axes: Axes, experiment: Experiment, key: str) -> None:
    """Draw the mean and the range of the runs that reached each mark. The line is interrupted where runs end."""
    color = COLORS[experiment.layout]
    marks = [mark for mark in experiment.marks if experiment.at(mark, key)]
    for _, part in groupby(marks, lambda mark: len(experiment.at(mark, key))):
        millions, values = zip(*((mark / 1e6, experiment.at(mark, key)) for mark in part), strict=True)
        axes.plot(millions, [np.mean(each) for each in values], color=color, lw=2)
        axes.fill_between(millions, [min(v) for v in values], [max(v) for v in values], color=color, alpha=0.35, lw=0)


def _set_axes(axes: Axes, game: str, key: str) -> None:
    """Label and scale the axes; timesteps are on a logarithmic scale, because most runs are short."""
    axes.set_xscale("log")
    axes.set_xlim(MARK / 1e6, COMPLETE / 1e6)
    axes.xaxis.set_major_locator(FixedLocator([0.3, 1, 3, 10, 30]))
    axes.xaxis.set_minor_locator(NullLocator())
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.set_ylim(*LIMITS[game, key])
    axes.set_title(f"{TITLES[game]}: {LABELS[key]}", loc="left", fontsize=10.5)
    if key == "click_accuracy":
        axes.yaxis.set_major_formatter(PercentFormatter(1.0))


def _add_steps(axes: Axes) -> None:
    """Add the original's steps as a second axis on top."""
    millions = TIMESTEPS_PER_STEP / 1e6  # of timesteps per step
    top = axes.secondary_xaxis("top", functions=(lambda x: np.divide(x, millions), lambda x: np.multiply(x, millions)))
    top.xaxis.set_major_locator(FixedLocator([2e4, 1e5, 2e5, 5e5, 1e6, 2e6]))
    top.xaxis.set_minor_locator(NullLocator())
    top.xaxis.set_major_formatter(EngFormatter(sep="\N{THIN SPACE}"))
    top.tick_params(labelsize=8.5, colors="#666666")
    top.set_xlabel("the original's steps", fontsize=8.5, color="#666666")


def _draw_hours(results: Results, path: Path) -> Path:
    """Draw the hours of a complete run of every experiment, ours and the original's."""
    figure, panels = plt.subplots(1, 2, figsize=(11, 4.2), layout="constrained", sharey=True, sharex=True)
    for axes, game in zip(panels, GAMES, strict=True):
        for height, layout in enumerate(COLORS):
            _add_hours(axes, results, game, layout, height)
        axes.set_xscale("log")
        axes.set_xlim(0.08, 60)
        axes.xaxis.set_major_locator(FixedLocator([0.1, 1 / 3, 1, 3, 10, 30]))
        axes.xaxis.set_minor_locator(NullLocator())
        axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _: _duration(value)))
        axes.set_yticks(range(len(COLORS)), list(COLORS))
        axes.set_ylim(len(COLORS) - 0.5, -0.5)
        axes.set_title(f"{TITLES[game]}: time of a complete run", loc="left", fontsize=10.5)
        axes.grid(visible=False, axis="y")
        axes.spines["top"].set_visible(False)
        axes.tick_params(left=False)
    circle: dict[str, Any] = {"marker": "o", "ls": "", "ms": 8}
    figure.legend(
        handles=[
            Line2D([], [], color="#333333", label="ours, at the speed of short runs alone", **circle),
            Line2D([], [], color="#A0A0A0", label="the original's logs, mean of ten runs", **circle),
        ],
        loc="outside lower center",
        ncols=2,
        fontsize=9,
    )
    return save_figure(figure, path)


def _add_hours(axes: Axes, results: Results, game: str, layout: str, height: int) -> None:
    """Draw one experiment: ours on the left, the original's on the right, a line between them."""
    key = game, layout, main_policy(layout)
    alone, ends = results[key].alone if key in results else (), original_ends(*key)
    ours = float(np.mean([run.complete_hours for run in alone])) if alone else None
    theirs = float(np.mean(ends.hours)) if ends else None
    text: dict[str, Any] = {"textcoords": "offset points", "va": "center", "fontsize": 9}
    if ours and theirs:
        axes.plot([ours, theirs], [height, height], color="#D8D8D8", lw=2, zorder=1)
    if theirs:
        axes.plot(theirs, height, "o", color="#A0A0A0", ms=8)
        axes.annotate(_duration(theirs), (theirs, height), (8, 0), **text)
    if ours:
        axes.plot(ours, height, "o", color=COLORS[layout], ms=8)
        axes.annotate(_duration(ours), (ours, height), (-8, 0), ha="right", **text)


def _duration(hours: float) -> str:
    return f"{hours:.1f}".removesuffix(".0") + " h" if hours > 0.99 else f"{60 * hours:.0f} min"


def save_figure(figure: Figure, path: Path) -> Path:
    """Write a figure as a small PNG, and free it."""
    pictures.save_figure(figure, path)
    plt.close(figure)
    return path
