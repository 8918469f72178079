"""The pictures of a comparison, and how pictures are drawn: each for pages with a light and with a dark background."""

import io
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import EngFormatter, PercentFormatter
from PIL import Image

from joybridge.compare.analysis import Analysis, Band
from joybridge.config.files import storing, write_atomically
from joybridge.play.figures import save_vector

COLORS = ("#2f8fd6", "#e07b39", "#2ca58d", "#c45ab3", "#d9a400", "#7a6ff0", "#d64550", "#8a8f98")
COLUMNS = 3  # of panels in a picture of several tasks
LINES = ("-", "--", ":", "-.")  # one after the other when the colors are used up
INK = {"light": ("#1f2328", "#ffffff"), "dark": ("#e6edf3", "#0d1117")}  # text and background
CAPTIONS = {
    "scores": "Score of each run (dots), {center} (line) and its 95 % interval (bar)",
    "curves": "Learning curves: {center} over runs, with 95 % intervals. Dotted: the score to which the runs are timed",
    "held_out": "Held-out curves: {center} over runs, with 95 % intervals. Dotted: the lowest final score",
    "profiles": "Performance profiles: the fraction of runs whose score is above a value, with 95 % intervals",
}


def draw_pictures(
    analysis: Analysis, curves: Mapping[str, Analysis], folder: Path, mark: str = "", figures: str = ""
) -> list[Path]:
    """Write all pictures of a comparison into a folder, see `draw_themes`.

    curves: the statistics whose learning curves are drawn, by the name of the picture. mark: what names end with.
    """
    draws = {"scores": partial(_draw_scores, analysis), "profiles": partial(_draw_profiles, analysis)}
    draws |= {name: partial(_draw_curves, each) for name, each in curves.items()}
    return draw_themes({f"{name}{mark}": draw for name, draw in draws.items()}, folder, figures)


def draw_themes(draws: Mapping[str, Callable[[], Figure]], folder: Path, figures: str = "") -> list[Path]:
    """Write pictures into a folder, each for light and for dark pages. Raises StorageError.

    figures: the format in which each is also written for a paper; "": in none. Return the paths of these figures.
    """
    with storing(folder):
        folder.mkdir(parents=True, exist_ok=True)
    for theme, colors in INK.items():
        with mpl.rc_context(_page_style(*colors)):
            for name, draw in draws.items():
                save_figure(draw(), folder / picture(name, theme))
    with mpl.rc_context(_page_style("#000000", "#ffffff")):
        return [save_vector(draw(), folder / f"{name}.{figures}") for name, draw in draws.items() if figures]


def _page_style(ink: str, paper: str) -> Any:
    """Return settings of matplotlib for a color of the text and one of the background."""
    return {
        "font.size": 10, "axes.grid": True, "grid.alpha": 0.2, "grid.color": ink, "grid.linewidth": 0.6,
        "axes.spines.right": False, "axes.spines.top": False, "axes.edgecolor": ink, "axes.labelcolor": ink,
        "text.color": ink, "xtick.color": ink, "ytick.color": ink, "legend.frameon": False,
        "figure.facecolor": paper, "axes.facecolor": paper, "axes.formatter.useoffset": False,
    }  # fmt: skip


class Line(NamedTuple):
    """How the score of one run rose."""

    label: str  # of its variant
    seconds: list[float]
    scores: list[float]


def draw_times(tasks: Mapping[str, Sequence[Line]]) -> Figure:
    """Return a panel for each task, with a line per run over seconds; runs of a variant share a color."""
    labels = list(dict.fromkeys(line.label for lines in tasks.values() for line in lines))
    columns = max(1, min(COLUMNS, len(tasks)))
    rows = max(1, -(-len(tasks) // columns))
    figure = Figure(figsize=(3 * columns + 1.5, 0.6 + 2.4 * rows), layout="constrained")
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    drawn: dict[str, Any] = {}
    for axes, (task, lines) in zip(panels, tasks.items(), strict=False):
        axes.set_title(without_formula(task), fontsize=10)
        for line in lines:
            color, style = _style(labels.index(line.label))
            (drawn[line.label],) = axes.plot(line.seconds, line.scores, color=color, ls=style, lw=1.2)
    for axes in panels[len(tasks) :]:
        axes.set_visible(False)
    figure.supxlabel("seconds", fontsize=10)
    figure.legend([*drawn.values()], [*map(without_formula, drawn)], loc="outside upper left", fontsize=9)
    return figure


def picture(name: str, theme: str) -> str:
    """Return the name of the file of a picture."""
    return f"{name}-{theme}.png"


def _draw_scores(analysis: Analysis) -> Figure:
    figure = Figure(figsize=(9, 0.9 + 0.42 * len(analysis.results)), layout="constrained")
    axes = figure.subplots()
    for height, result in enumerate(analysis.results):
        color, _ = _style(height)
        axes.barh(height, result.iqm.high - result.iqm.low, 0.5, result.iqm.low, color=color, alpha=0.35, lw=0)
        axes.vlines(result.iqm.value, height - 0.25, height + 0.25, color=color, lw=2.5)
        axes.plot(result.scores, [height] * len(result.scores), "o", color=color, ms=4.5, mec=axes.get_facecolor())
    axes.use_sticky_edges = False  # bars would end at the frame
    axes.margins(x=0.03)
    axes.autoscale_view()
    axes.set_yticks(range(len(analysis.results)), [without_formula(result.label) for result in analysis.results])
    axes.set_ylim(len(analysis.results) - 0.5, -0.5)
    axes.grid(visible=False, axis="y")
    axes.set_axisbelow(True)
    measured = any(run.measured is not None for result in analysis.results for run in result.runs)
    what = "mean of the episodes without learning" if measured else "mean of the last tenth of a run"
    axes.set_xlabel(without_formula(f"{analysis.metric}, {what}"))
    return figure


def _draw_curves(analysis: Analysis) -> Figure:
    figure = Figure(figsize=(9, 4.6), layout="constrained")
    axes = figure.subplots()
    for index, result in enumerate(analysis.results):
        _draw_band(axes, result.curve, index, result.label)
    axes.axhline(analysis.score, color=mpl.rcParams["text.color"], alpha=0.5, lw=0.8, ls=(0, (1, 3)))
    axes.xaxis.set_major_formatter(EngFormatter(sep="\N{THIN SPACE}"))
    axes.set(xlabel="timesteps", ylabel=without_formula(analysis.metric))
    _add_legend(figure, axes)
    return figure


def _draw_profiles(analysis: Analysis) -> Figure:
    figure = Figure(figsize=(9, 4.2), layout="constrained")
    axes = figure.subplots()
    for index, result in enumerate(analysis.results):
        _draw_band(axes, result.profile, index, result.label, steps=True)
    axes.set(xlabel=without_formula(f"score ({analysis.metric})"), ylabel="runs above this score", ylim=(-0.02, 1.02))
    axes.yaxis.set_major_formatter(PercentFormatter(1.0))
    _add_legend(figure, axes)
    return figure


def draw_over(
    bands: Mapping[str, Band], values: Sequence[str], names: tuple[str, str], trained: tuple[float, float] | None
) -> Figure:
    """Return a line with its band for each variant over the values of a setting.

    bands: by label; where each value stands is their `x`. values: as they are written. names: of the two axes. trained:
    between which values it was in the training.
    """
    figure = Figure(figsize=(9, 4.6), layout="constrained")
    axes = figure.subplots()
    if trained is not None:
        low, high = trained
        axes.axvspan(low, high, color="gray", alpha=0.2, lw=0 if low < high else 2, label="as trained")
    for index, (label, band) in enumerate(bands.items()):
        _draw_band(axes, band, index, label)
        axes.plot(band.x, band.value, "o", color=_style(index)[0], ms=4.5)
    axes.set_xticks(next(iter(bands.values())).x, [*map(without_formula, values)])
    axes.set(xlabel=without_formula(names[0]), ylabel=without_formula(names[1]))
    _add_legend(figure, axes)
    return figure


def _draw_band(axes: Axes, band: Band, index: int, label: str, *, steps: bool = False) -> None:
    color, line = _style(index)
    marker = "o" if len(band.x) == 1 else ""
    axes.plot(
        band.x,
        band.value,
        color=color,
        ls=line,
        lw=1.8,
        marker=marker,
        label=without_formula(label),
        drawstyle="steps-post" if steps else "default",
    )
    axes.fill_between(band.x, band.low, band.high, color=color, alpha=0.15, lw=0, step="post" if steps else None)


def _add_legend(figure: Figure, axes: Axes) -> None:
    figure.legend(*axes.get_legend_handles_labels(), loc="outside right upper", fontsize=9)


def _style(index: int) -> tuple[str, str]:
    """Return the color and the style of the line of a variant."""
    return COLORS[index % len(COLORS)], LINES[index // len(COLORS) % len(LINES)]


def without_formula(text: str) -> str:
    """Return a text in which dollar signs do not begin a formula."""
    return text.replace("$", r"\$")


def save_figure(figure: Figure, path: Path) -> None:
    """Write a small PNG: 256 colors are enough for curves and bars. Raises StorageError."""
    drawn, small = io.BytesIO(), io.BytesIO()
    figure.savefig(drawn, dpi=110)
    Image.open(drawn).convert("RGB").quantize(256, Image.Quantize.MEDIANCUT, kmeans=4).save(small, "PNG", optimize=True)
    write_atomically(path, small.getvalue())
