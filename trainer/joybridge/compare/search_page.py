"""The page of a search: Markdown and HTML with the same text, its pictures, and its trials as CSV."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from itertools import accumulate
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from optuna.trial import FrozenTrial, TrialState

from joybridge.compare.page_parts import (
    PICTURES,
    csv_text,
    escaped,
    number_text,
    page_html,
    picture_block,
    table,
    write_files,
)
from joybridge.compare.pictures import COLORS, draw_themes, without_formula
from joybridge.compare.ranges import Numbers, Range, settings_of

SHOWN = 10  # of the complete trials, the best
STATES = {
    TrialState.RUNNING: "running",
    TrialState.COMPLETE: "complete",
    TrialState.PRUNED: "pruned",
    TrialState.FAIL: "failed",
}
CAPTIONS = {
    "trials": "Score of each trial in the order of proposal. Crosses: pruned trials, where they ended. Line: the best "
    "score so far",
    "keys": "Score over each key. Crosses: pruned trials",
}


@dataclass(frozen=True)
class Outcome:
    """A search that has ended, at least one of its trials complete."""

    game: str
    metric: str
    timesteps: int  # of a complete trial
    seed: int
    ranges: Sequence[Range]
    trials: Sequence[FrozenTrial]
    best: int  # number of the trial with the highest score
    own: bool  # the first trial has the settings of the configuration itself
    next_commands: Sequence[str]
    command: str  # that makes this search
    rung_metric: str = ""  # of the rungs, if the metric is measured only at the end
    figures: str = ""  # the format in which pictures are also written, for a paper


def write_page(result: Outcome, folder: Path) -> list[Path]:
    """Write the page, its pictures and the trials into a folder. Return the paths of all but the page's pictures.

    Raises StorageError.
    """
    draws = {"trials": _draw_trials, "keys": _draw_keys}
    drawn = draw_themes(
        {name: partial(draw, result) for name, draw in draws.items()}, folder / PICTURES, result.figures
    )
    text = page_text(result)
    files = {"page.md": text, "page.html": page_html(text, folder), "trials.csv": trials_csv(result)}
    return [*write_files(files, folder), *drawn]


def page_text(result: Outcome) -> str:
    """Return the page as Markdown."""
    states = [STATES[trial.state] for trial in result.trials]
    counts = ", ".join(f"{states.count(state)} {state}" for state in ("complete", "pruned", "failed"))
    blocks = [
        f"# {escaped(result.game)}: a search of {len(states)} trials",
        f"{counts}. A complete trial has {result.timesteps:,} timesteps. The score is {_score_text(result)}; higher is "
        "better. A trial whose scores so far were all below the median of the complete trials at the same point was "
        "pruned.",
        f"**Each trial is one training with seed {result.seed}.** The best of many trials is also the luckiest: "
        f"compare its settings with the configuration's own over other seeds before you trust them.",
        "## Best trials",
        ranking(result),
        "## All trials",
        picture_block("trials", CAPTIONS["trials"]),
        "## Keys",
        "\n".join(f"- `{each}`" for each in result.ranges),
        picture_block("keys", CAPTIONS["keys"]),
    ]
    if "failed" in states:
        failed = (f"- {trial.number}: {escaped(outcome(trial))}" for trial in _of(result, TrialState.FAIL))
        blocks += ["## Failed trials", "\n".join(failed)]
    blocks += ["## Next", "```sh\n" + "\n".join(result.next_commands) + "\n```"]
    blocks += ["## Again", f"```sh\n{result.command}\n```"]
    return "\n\n".join(blocks) + "\n"


def ranking(result: Outcome) -> str:
    """Return the best complete trials as a table in Markdown, and that of the configuration's own settings."""
    ranked = sorted(_of(result, TrialState.COMPLETE), key=lambda trial: (-_score(trial), trial.number))
    rows = []
    for trial in ranked[:SHOWN] + [trial for trial in ranked[SHOWN:] if trial.number == 0 and result.own]:
        name = f"**{trial.number}**" if trial.number == result.best else f"{trial.number}"
        name += " (own settings)" if trial.number == 0 and result.own else ""
        settings = map(escaped, settings_of(result.ranges, trial.params).values())
        rows.append((name, number_text(_score(trial)), *settings))
    return table(("trial", "score", *(escaped(short(each.key)) for each in result.ranges)), rows)


def trials_csv(result: Outcome) -> str:
    """Return a line per trial: what it was, and what it came to."""
    lines: list[Sequence[object]] = [
        ("trial", "state", "timesteps", result.metric, *(each.key for each in result.ranges))
    ]
    for trial in result.trials:
        timesteps = result.timesteps if trial.state == TrialState.COMPLETE else trial.last_step or 0
        settings = settings_of(result.ranges, trial.params).values()
        score = "" if trial.value is None else repr(trial.value)
        lines.append((trial.number, STATES[trial.state], timesteps, score, *settings))
    return csv_text(lines)


def outcome(trial: FrozenTrial) -> str:
    """Return what a trial has come to, in words."""
    if trial.state == TrialState.FAIL:
        return f"failed: {trial.user_attrs.get('reason', 'unknown')}"
    if trial.state == TrialState.PRUNED:
        return f"pruned after {trial.last_step:,} timesteps, score {trial.value:.4g}"
    return f"complete, score {trial.value:.4g}" if trial.state == TrialState.COMPLETE else "running"


def short(key: str) -> str:
    """Return a key as tables call it."""
    return key.removeprefix("policy.")


def settings_text(ranges: Sequence[Range], trial: FrozenTrial) -> str:
    """Return the settings of a trial in one line."""
    return ", ".join(f"{short(key)}={value}" for key, value in settings_of(ranges, trial.params).items())


def _score_text(result: Outcome) -> str:
    if not result.rung_metric:
        return f"the mean *{escaped(result.metric)}* of the last tenth of the timesteps"
    return (
        f"the *{escaped(result.metric)}* that is measured at the end. Until there, and of pruned trials everywhere, it "
        f"is the mean *{escaped(result.rung_metric)}* of the training"
    )


def _score(trial: FrozenTrial) -> float:
    """Return the score of a complete trial, or what a pruned one had reached."""
    assert trial.value is not None
    return trial.value


def _of(result: Outcome, state: TrialState) -> list[FrozenTrial]:
    """Return the trials that have ended like this."""
    return [trial for trial in result.trials if trial.state == state]


def _draw_trials(result: Outcome) -> Figure:
    figure = Figure(figsize=(9, 3.6), layout="constrained")
    axes = figure.subplots()
    complete = _of(result, TrialState.COMPLETE)
    best = list(accumulate(map(_score, complete), max))
    axes.plot([trial.number for trial in complete], best, color=COLORS[1], drawstyle="steps-post", lw=1.6)
    _draw_points(axes, result, lambda trial: trial.number)
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
            _draw_points(axes, result, lambda trial, key=each.key: trial.params[key])
            axes.set_xscale("log" if each.log else "linear")
        else:
            _draw_points(axes, result, lambda trial, each=each: each.values.index(trial.params[each.key]))
            axes.set_xticks(range(len(each.values)), [without_formula(value) for value in each.values])
            axes.set_xlim(-0.5, len(each.values) - 0.5)
        axes.set_xlabel(without_formula(short(each.key)))
    for axes in list(figure.axes)[len(result.ranges) :]:
        axes.set_visible(False)
    for axes in list(figure.axes)[::columns]:
        axes.set_ylabel("score")
    return figure


def _draw_points(axes: Axes, result: Outcome, x: Any) -> None:
    """Draw all trials at (x(trial), score)."""
    for state, color, marker in ((TrialState.PRUNED, COLORS[-1], "x"), (TrialState.COMPLETE, COLORS[0], "o")):
        trials = _of(result, state)
        axes.plot([x(trial) for trial in trials], [_score(trial) for trial in trials], marker, color=color, ms=5)
    best, edge = result.trials[result.best], mpl.rcParams["text.color"]
    axes.plot([x(best)], [_score(best)], "o", color=COLORS[1], mec=edge, ms=7, zorder=4)
