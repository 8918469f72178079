"""The figure of the behavior of trained policies."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np

mpl.use("Agg")
import matplotlib.pyplot as plt
from matplotlib.axes import Axes

from joybridge.compare import RunName
from tools.paper.figures import COLORS, save_figure

Known = Mapping[str, dict[str, Any]]  # measures by "GAME/RUN"

# Of each panel a title, then one or two measures. Lists are drawn as lines.
PANELS = {
    "shooting_birds": [
        ("Hits per episode", "hits_per_level"),
        ("Crosshair: mean |vx| and, pale, |vy|, units/s", "abs_vx", "abs_vy"),
        ("Seconds between two shots", "seconds_between_shots"),
        ("Click accuracy", "click_accuracy"),
    ],
    "beastly_rivals": [
        ("Lap radius, m", "lap_radius"),
        ("Commands per decision", "commands_per_decision"),
        ("Share of time in the slow sphere; pale: by chance", "slow_share", "slow_share_by_chance"),
        ("Survival per episode, s", "survival_seconds"),
    ],
}
OTHERS = ("#999999", "#6A3D9A", "#B2A300")  # colors of layouts that are not among the paper's
ABSCISSAE = {  # what lists are drawn over
    "lap_radius": "episode time, s",
    "hits_per_level": "level",
}


def draw(known: Known, output: Path) -> None:
    """Draw the measures of each game, in a color per layout: the mean of its longest runs."""
    games = [game for game in PANELS if any(name.startswith(f"{game}/") for name in known)]
    layouts = {game: _longest(known, game) for game in games}
    names = sorted({name for of in layouts.values() for name in of}, key=_by_size)
    colors = {name: COLORS.get(name.partition(",")[0], OTHERS[i % len(OTHERS)]) for i, name in enumerate(names)}
    figure, rows = plt.subplots(len(games), 4, figsize=(18, 4.4 * len(games)), layout="constrained", squeeze=False)
    for game, panels in zip(games, rows, strict=True):
        panels[0].set_ylabel(game.replace("_", " ").title(), fontsize=12)
        for panel, (title, *keys) in zip(panels, PANELS[game], strict=True):
            (_lines if keys[0] in ABSCISSAE else _bars)(panel, layouts[game], colors, *keys)
            panel.set_title(title, fontsize=10)
            panel.spines[["top", "right"]].set_visible(False)
    output.parent.mkdir(parents=True, exist_ok=True)
    save_figure(figure, output)


def _longest(known: Known, game: str) -> dict[str, list[dict[str, Any]]]:
    """Return the longest trained runs of each layout of a game, by layout and length."""
    layouts: dict[str, list[dict[str, Any]]] = {}
    for name, entry in known.items():
        if name.startswith(f"{game}/"):
            layouts.setdefault(_layout(name.removeprefix(f"{game}/")), []).append(entry)
    ends = {layout: max(entry["timesteps"] for entry in entries) for layout, entries in layouts.items()}
    return {
        f"{name}, {ends[name] / 1e6:.2g} M": [entry for entry in layouts[name] if entry["timesteps"] == ends[name]]
        for name in sorted(layouts, key=_by_size)
    }


def _layout(folder: str) -> str:
    """Return the layout of a run's folder; the folder's name if it is not that of a run."""
    try:
        return RunName.parse(folder).experiment
    except ValueError:
        return folder


def _by_size(layout: str) -> tuple[int, str]:
    """Sort bucket-3 before bucket-11."""
    return len(layout), layout


def _lines(axes: Axes, layouts: dict[str, list[dict[str, Any]]], colors: dict[str, str], key: str) -> None:
    """Draw the mean of the runs' lists, which hold points, or numbers to draw over their index."""
    for layout, entries in layouts.items():
        lists = [[p if isinstance(p, list) else [i, p] for i, p in enumerate(entry[key])] for entry in entries]
        means = np.array([np.mean(points, axis=0) for points in zip(*lists, strict=False)])
        if len(means):
            axes.plot(*means.T, color=colors[layout], marker=".", label=layout)
    axes.set(xlabel=ABSCISSAE[key], ylim=(0, None))
    axes.grid(alpha=0.3)
    axes.legend(frameon=False, fontsize=8, loc="upper left", bbox_to_anchor=(1, 1))


def _bars(axes: Axes, layouts: dict[str, list[dict[str, Any]]], colors: dict[str, str], *keys: str) -> None:
    """Draw bars of one or two measures side by side, the second in a lighter color, with a dot per run."""
    width = 0.8 / len(keys)
    for place, (layout, entries) in enumerate(layouts.items()):
        for number, key in enumerate(keys):
            values = [entry[key] for entry in entries if entry[key] is not None]
            x = place + (number - (len(keys) - 1) / 2) * width
            axes.bar(x, np.mean(values or [0.0]), width, color=colors[layout], alpha=0.4 if number else 0.9)
            axes.plot([x] * len(values), values, ".", color="black", markersize=4)
    axes.set_xticks(range(len(layouts)), list(layouts), rotation=35, ha="right", fontsize=8)
