"""The page of a search: Markdown and HTML with the same text, its pictures, and its trials as CSV."""

import csv
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import EngFormatter, MaxNLocator

from joybridge.compare.page import PICTURES, escaped, number_text, page_html, picture_block, table
from joybridge.compare.pictures import COLORS, draw_themes, without_formula
from joybridge.compare.ranges import Numbers, Range
from joybridge.compare.search_display import outcome, short
from joybridge.compare.trials import Trial, best_trial
from joybridge.config.files import write_atomically

SHOWN = 10  # of the complete trials, the best
ENOUGH = 10  # complete trials, before the keys are ranked
CAPTIONS = {
    "trials": "Score of each trial in the order of proposal. Crosses: pruned trials, where they ended. Line: the best "
    "score so far",
    "keys": "Score over each key. Crosses: pruned trials",
    "curves": "Score so far of each trial. Gray: pruned; orange: the best",
}


@dataclass(frozen=True)
class Outcome:
    """A search that has ended, at least one of its trials complete."""

    game: str
    metric: str
    timesteps: int  # of a complete trial
    seed: int
    ranges: Sequence[Range]
    trials: Sequence[Trial]
    own: bool  # the first trial has the settings of the configuration itself
    importances: Mapping[str, float]  # of the keys; empty with too few trials
    next_commands: Sequence[str]
    command: str  # that makes this search

    @property
    def best(self) -> int:
        """Return the number of the best trial."""
        best = best_trial(self.trials)
        assert best is not None
        return best


def write_page(result: Outcome, folder: Path) -> list[Path]:
    """Write the page, its pictures and the trials into a folder. Return the paths of all but the pictures.

    Raises StorageError.
    """
    draws = {"trials": _draw_trials, "keys": _draw_keys, "curves": _draw_curves}
    draw_themes({name: partial(draw, result) for name, draw in draws.items()}, folder / PICTURES)
    text = page_text(result)
    files = {"page.md": text, "page.html": page_html(text, folder), "trials.csv": trials_csv(result)}
    for name, content in files.items():
        write_atomically(folder / name, content.encode())
    return [folder / name for name in files]


def page_text(result: Outcome) -> str:
    """Return the page as Markdown."""
    states = [trial.state for trial in result.trials]
    counts = ", ".join(f"{states.count(state)} {state}" for state in ("complete", "pruned", "failed"))
    blocks = [
        f"# {escaped(result.game)}: a search of {len(states)} trials",
        f"{counts}. A complete trial has {result.timesteps:,} timesteps. The score is the mean "
        f"*{escaped(result.metric)}* of the last tenth of the rows of metrics; higher is better. A trial whose scores "
        "so far were all below the median of the complete trials at the same point was pruned.",
        f"**Each trial is one training with seed {result.seed}.** The best of many trials is also the luckiest: "
        f"compare its settings with the configuration's own over other seeds before you trust them.",
        "## Best trials", ranking(result), "## All trials", picture_block("trials", CAPTIONS["trials"]),
        "## Keys", "\n".join(f"- `{each}`" for each in result.ranges), *_importances(result),
        picture_block("keys", CAPTIONS["keys"]), "## Learning curves", picture_block("curves", CAPTIONS["curves"]),
    ]  # fmt: skip
    if "failed" in states:
        failed = (f"- {number}: {escaped(outcome(trial))}" for number, trial in enumerate(result.trials)
                  if trial.state == "failed")  # fmt: skip
        blocks += ["## Failed trials", "The search took their settings for bad ones. The command, repeated, tries them "
                   "again.", "\n".join(failed)]  # fmt: skip
    blocks += ["## Next", "```sh\n" + "\n".join(result.next_commands) + "\n```"]
    blocks += ["## Again", f"```sh\n{result.command}\n```"]
    return "\n\n".join(blocks) + "\n"


def ranking(result: Outcome) -> str:
    """Return the best complete trials as a table in Markdown, and that of the configuration's own settings."""
    complete = [number for number, trial in enumerate(result.trials) if trial.state == "complete"]
    ranked = sorted(complete, key=lambda number: (-_score(result.trials[number]), number))
    shown = ranked[:SHOWN] + [number for number in ranked[SHOWN:] if number == 0 and result.own]
    rows = []
    for number in shown:
        trial, name = result.trials[number], f"{number}"
        name = f"**{name}**" if number == result.best else name
        name += " (own settings)" if number == 0 and result.own else ""
        settings = (escaped(trial.settings[each.key]) for each in result.ranges)
        rows.append((name, number_text(_score(trial)), *settings))
    return table(("trial", "score", *(escaped(short(each.key)) for each in result.ranges)), rows)


def trials_csv(result: Outcome) -> str:
    """Return a line per trial: what it was, and what it came to."""
    text = io.StringIO(newline="")
    lines = csv.writer(text, lineterminator="\n")
    lines.writerow(("trial", "state", "timesteps", result.metric, *(each.key for each in result.ranges)))
    for number, trial in enumerate(result.trials):
        reached = "" if trial.state == "failed" else repr(_score(trial))
        settings = (trial.settings[each.key] for each in result.ranges)
        lines.writerow((number, trial.state, trial.timesteps, reached, *settings))
    return text.getvalue()


def _importances(result: Outcome) -> list[str]:
    if not result.importances:
        return []
    rows = [(escaped(short(key)), f"{100 * share:.0f} %") for key, share in result.importances.items()]
    return [
        "How much each key matters for reaching the best scores, by "
        "[PED-ANOVA](https://arxiv.org/abs/2304.10255); a rough estimate with so few trials:",
        table(("key", "importance"), rows),
    ]


def _score(trial: Trial) -> float:
    """Return the score of a complete trial, or what a pruned one had reached."""
    return trial.score if trial.score is not None else list(trial.rungs.values())[-1]


def _with_scores(result: Outcome, state: str) -> list[int]:
    return [number for number, trial in enumerate(result.trials) if trial.state == state]


def _draw_trials(result: Outcome) -> Figure:
    figure = Figure(figsize=(9, 3.6), layout="constrained")
    axes = figure.subplots()
    complete = _with_scores(result, "complete")
    best = [max(_score(result.trials[each]) for each in complete[: index + 1]) for index in range(len(complete))]
    axes.plot(complete, best, color=COLORS[1], drawstyle="steps-post", lw=1.6)
    _draw_points(axes, result, lambda number: number)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set(xlabel="trial", ylabel=without_formula(f"score ({result.metric})"))
    return figure


def _draw_keys(result: Outcome) -> Figure:
    columns = min(3, len(result.ranges))
    rows = -(-len(result.ranges) // columns)
    figure = Figure(figsize=(9, 2.9 * rows), layout="constrained")
    panels = figure.subplots(rows, columns, sharey=True, squeeze=False).flat
    for axes, each in zip(panels, result.ranges, strict=False):
        if isinstance(each, Numbers):
            _draw_points(axes, result, lambda number, each=each: each.read(result.trials[number].settings[each.key]))
            axes.set_xscale("log" if each.log else "linear")
        else:
            _draw_points(
                axes, result, lambda number, each=each: each.values.index(result.trials[number].settings[each.key])
            )
            axes.set_xticks(range(len(each.values)), [without_formula(value) for value in each.values])
            axes.set_xlim(-0.5, len(each.values) - 0.5)
        axes.set_xlabel(without_formula(short(each.key)))
    for axes in list(figure.axes)[len(result.ranges) :]:
        axes.set_visible(False)
    for axes in list(figure.axes)[::columns]:
        axes.set_ylabel("score")
    return figure


def _draw_curves(result: Outcome) -> Figure:
    figure = Figure(figsize=(9, 3.9), layout="constrained")
    axes = figure.subplots()
    for number, trial in enumerate(result.trials):
        line = {**trial.rungs, **({trial.timesteps: trial.score} if trial.score is not None else {})}
        color = COLORS[1] if number == result.best else COLORS[0] if trial.state == "complete" else COLORS[-1]
        over = 3 if number == result.best else 2
        axes.plot(list(line), list(line.values()), color=color, lw=1.2 if over == 2 else 2.2, zorder=over, marker=".")
    axes.xaxis.set_major_formatter(EngFormatter(sep="\N{THIN SPACE}"))
    axes.set(xlabel="timesteps", ylabel=without_formula(f"score so far ({result.metric})"))
    return figure


def _draw_points(axes: Axes, result: Outcome, x: Any) -> None:
    """Draw all trials at (x(number), score)."""
    for state, color, marker in (("pruned", COLORS[-1], "x"), ("complete", COLORS[0], "o")):
        numbers = _with_scores(result, state)
        scores = [_score(result.trials[number]) for number in numbers]
        axes.plot([x(number) for number in numbers], scores, marker, color=color, ms=5)
    edge = mpl.rcParams["text.color"]
    axes.plot([x(result.best)], [_score(result.trials[result.best])], "o", color=COLORS[1], mec=edge, ms=7, zorder=4)
