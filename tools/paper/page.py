"""The page about the finished runs in results/: figures, tables and claims, ours beside the original's."""

import json
from collections.abc import Sequence
from pathlib import Path
from statistics import mean, stdev

from tools.paper.claims import Behavior, make_claims
from tools.paper.figures import TITLES, draw_figures
from tools.paper.original import TIMESTEPS_PER_STEP, original_ends, original_point, paper_figures
from tools.paper.runs import (
    COMPLETE,
    MARK,
    Experiment,
    Results,
    Run,
    interquartile_mean,
    interval,
    main_policy,
    read_results,
)
from tools.paper.statistics import FAILS, HOLDS, differ, sample

RESULTS = Path(__file__).resolve().parents[2] / "results"  # the project's own
MARKS = (300_000, 1_200_000, 1_500_000, 3_000_000, 15_000_000, COMPLETE)  # timesteps that the last table compares at
LAST_TEN = tuple(range(COMPLETE - 9 * MARK, COMPLETE + 1, MARK))
COURSES = ("lap_radius",)  # behavior over time, which only a plot can show
CAPTIONS = {
    "figure-11-threshold.png": "Figure 11: the threshold approach.",
    "figure-12-bucket.png": "Figure 12: the bucket approach with 3, 11 and 41 values per axis.",
    "figure-13-approaches.png": "Figure 13: all approaches; hybrid is not in the paper.",
    "figure-14-training-time.png": "Figure 14: training time, on a logarithmic scale.",
}
INTRODUCTION = """\
# The paper's experiments: our runs beside the original's

Written by `python -m tools.paper report` from the metrics in the folders beside this page, which are named by the
length of their runs; of several lengths of one run the longest counts. Runs of one seed whose first rows differ
count as different runs: with another number of `groups` (a setting of the trainer), for one, everything is rounded
differently. The original's figures are from its logs of ten runs per experiment; its click accuracies were only
printed in the paper. Reward is the mean over the episodes of the 300 000 timesteps (20 000 steps of the original)
before each mark, as in its logs. The reward of the two agents is that of the one that clicks, as in the paper."""
COMPLETE_RUNS = """\
Each run of 30 M timesteps, and the original's mean ± two standard deviations of its ten runs at the same number of
timesteps. Hours are wall-clock, on a machine that did other work as well."""
FIGURES = """\
Where runs are of different lengths, the mean is over those that got there, and the line breaks where they get fewer.
Time is on logarithmic scales. Our times in figure 14 are what 30 M timesteps take at the speed of short runs that had
the machine to themselves, one at a time and in turns (those in `alone/`)."""
RULES = """\
Every test is at the 5 % level. Scores are compared by Welch's t test, the scatter of our runs pooled with that of
the original's ten, as a few runs do not tell it; they are alike if they do not differ and the confidence interval of
the difference is within 10 points. Stability is an F test of variances. Both are judged at the longest length that
all the runs a claim needs have reached; before the complete length only if the original's curves show the claim
there and to the end. Training times are those of figure 14, compared turn by turn, by a t test of the ratios'
logarithms. Click accuracies of complete runs differ from one point on. Behavior must be shown by all complete runs
of the paper's approaches: laps in the last third of the time below 0.9 of those in the first, at most 10 blinks in
10 000 decisions, time in the slow sphere between 1/1.5 and 1.5 of what chance gives (not asked of the two agents,
whom it never slows)."""
CONTRADICTIONS = """\
Where the original's own logs do not bear its paper out, by the same rules:"""
DETAILS = """\
The figures behind each verdict, with the number of runs in brackets; ± is one standard deviation of runs."""
BEHAVIOR = """\
Measured by `python -m tools.paper.behavior` on trained policies. Speeds are in units/s, `slow share` is of the time.
The original's published bucket-11 network, replayed, hits 157 157 127 173 131 168 78 birds in levels 0 to 6."""
EXPERIMENTS = """\
At the end of the runs; where they differ in length there is a line per length, over all that got there. In square
brackets the 95 % bootstrap confidence interval of the mean, which of two or three runs is no more than the lowest and
the highest; the interquartile mean (IQM) leaves out the lowest and the highest quarter of the runs, none of up to
three. Hours are of runs that shared the machine with others. Logs ± one standard deviation."""
BY_MARKS = """\
Mean of our runs, in brackets their number; then the original's mean ± two standard deviations of a run. **Bold**:
the means differ by Student's t test at the 5 % level, as one in twenty cells does by chance. At the first mark runs of
one seed are still alike, and 75 arenas cost Shooting Birds some reward, see [DECISIONS](../DECISIONS.md)."""


def write_report(results: Path) -> list[Path]:
    """Draw the figures, write the page into `results` and return the paths of the pages written."""
    experiments = read_results(results)
    path = results / "behavior.json"
    behavior: Behavior = json.loads(path.read_text()) if path.exists() else {}
    pictures = [picture.name for picture in draw_figures(experiments, results / "figures")]
    blocks = [
        INTRODUCTION,
        "## Complete runs", COMPLETE_RUNS, complete_runs(experiments),
        "## The figures of the paper", FIGURES,
        *(f"![{CAPTIONS[name]}](figures/{name})\n\n{CAPTIONS[name]}" for name in pictures),
        "## The paper's claims", *claims(experiments, behavior),
        *behaviors(behavior, results),
        "## Every experiment", EXPERIMENTS, every_experiment(experiments),
        "## Reward at some marks", BY_MARKS, *by_marks(experiments),
    ]  # fmt: skip
    page = results / "README.md"
    page.write_text("\n\n".join(blocks) + "\n", encoding="utf-8")
    return [page]


def complete_runs(results: Results) -> str:
    """Return a table that sets every complete run against the original's ten."""
    heads = ("run", "reward", "the original", "place", "last ten marks", "the original", "hours", "the original")
    rows = []
    for experiment in results.values():
        ends = original_ends(experiment.game, experiment.layout, experiment.policy)
        for run in experiment.complete:
            reward, last = run.rows[COMPLETE]["reward"], last_ten(run)
            rows.append((
                f"{TITLES[experiment.game]} {experiment.name}, seed {run.seed}",
                f"{reward:.1f}", _two_sigma(ends.reward) if ends else "",
                place(reward, ends.reward) if ends else "not in the paper",
                f"{last:.1f}", _two_sigma(ends.last_ten) if ends else "",
                f"{run.hours:.2f}", f"{mean(ends.hours):.1f}" if ends else "",
            ))  # fmt: skip
    return _table(heads, rows) if rows else "None has finished yet."


def last_ten(run: Run) -> float:
    """Return the mean reward of the last ten marks of a complete run."""
    return mean(run.rows[mark]["reward"] for mark in LAST_TEN if mark in run.rows)


def place(value: float, others: Sequence[float]) -> str:
    """Say where a value lies in respect of the mean ± two standard deviations of others."""
    if abs(value - mean(others)) <= 2 * stdev(others):
        return "inside"
    return "above" if value > mean(others) else "**below**"


def claims(results: Results, behavior: Behavior) -> list[str]:
    """State every claim with our verdict and the original's own, then the figures behind them."""
    rows, details, contradictions = [], [], []
    for number, claim in enumerate(make_claims(), 1):
        verdict, logs = claim.judge(results, behavior), claim.logs
        here = f"**{verdict.word}** {verdict.where}".strip()
        rows.append((f"{number}", claim.text, TITLES[claim.game], here, logs.word if logs else "do not tell"))
        details.append(f"{number}. Here: {verdict.evidence}." + (f" Logs: {logs.evidence}." if logs else ""))
        if logs and logs.word != HOLDS:
            said = "contradict" if logs.word == FAILS else "do not decide"
            contradictions.append(f"- They {said} claim {number}, {TITLES[claim.game]}: {logs.evidence}.")
    return [
        RULES, _table(("", "the paper says", "game", "here", "the original's logs"), rows),
        CONTRADICTIONS, "\n".join(contradictions), DETAILS, "\n".join(details),
    ]  # fmt: skip


def behaviors(behavior: Behavior, results: Path) -> list[str]:
    """Tabulate what `python -m tools.paper.behavior` measured of trained policies, except for courses over time."""
    blocks = []
    for game, title in TITLES.items():
        chosen = {name: figures for name, figures in sorted(behavior.items()) if name.startswith(f"{game}/")}
        keys = dict.fromkeys(key for figures in chosen.values() for key in figures if key not in COURSES)
        rows = [
            (name.removeprefix(f"{game}/"), *(_figure(figures.get(key)) for key in keys))
            for name, figures in chosen.items()
        ]
        if rows:
            blocks += [f"{title}:", _table(("policy", *(key.replace("_", " ") for key in keys)), rows)]
    if blocks and (results / "figures" / "behavior.png").exists():
        blocks.append("![Behavior of trained policies](figures/behavior.png)")
    return ["## Learned behavior", BEHAVIOR, *blocks] if blocks else []


def every_experiment(results: Results) -> str:
    """Return a table of every experiment at the ends of its runs."""
    heads = (
        "experiment", "timesteps", "runs", "reward", "IQM", "accuracy or length", "hours per run",
        "timesteps/s alone",
        "logs: reward", "logs: IQM", "logs: length", "paper: reward", "paper: accuracy or length", "paper: hours",
    )  # fmt: skip
    return _table(
        heads,
        [
            _experiment_row(experiment, mark)
            for experiment in results.values()
            for mark in sorted({run.end for run in experiment.runs})
        ],
    )


def _experiment_row(experiment: Experiment, mark: int) -> Sequence[str]:
    key = game, layout, policy = experiment.game, experiment.layout, experiment.policy
    birds = game == "shooting_birds"
    rewards, second = experiment.at(mark), mean(experiment.at(mark, "click_accuracy" if birds else "length"))
    hours = mean(run.hours for run in experiment.runs if run.end == mark)
    alone = [run.complete_hours for run in experiment.alone]
    point, ends = original_point(*key, mark), original_ends(*key) if mark == COMPLETE else None
    theirs = f"{point.reward:.1f} ± {point.reward_std:.1f}" if point else ""
    printed = paper_figures(game, layout) if policy in ("", main_policy(layout)) else {}
    printed_second = printed.get("accuracy" if birds else "length")
    return (
        f"{TITLES[game]} {experiment.name}", f"{mark / 1e6:g} M", f"{len(rewards)}",
        f"{mean(rewards):.1f}{_interval(rewards)}",
        f"{interquartile_mean(rewards):.1f}" if len(rewards) > 1 else "one run",
        _percent(second) if birds else f"{second:.0f}", f"{hours:.2f}",
        f"{COMPLETE / 3600 / mean(alone):.0f}" if alone else "",
        theirs + (_interval(ends.reward) if ends else ""), f"{interquartile_mean(ends.reward):.1f}" if ends else "",
        f"{point.length:.0f} ± {point.length_std:.0f}" if point and not birds else "",
        _figure(printed.get("reward")),
        (_percent(printed_second) if birds else f"{printed_second:.0f}") if printed_second else "",
        _figure(printed.get("hours")),
    )  # fmt: skip


def by_marks(results: Results) -> list[str]:
    """Tabulate reward at some marks, of all runs, in bold where it differs from the original's."""
    blocks = []
    for game, title in TITLES.items():
        experiments = [experiment for experiment in results.values() if experiment.game == game]
        marks = [mark for mark in MARKS if any(experiment.at(mark) for experiment in experiments)]
        heads = [f"{mark / 1e6:g} M ({mark // TIMESTEPS_PER_STEP // 1000} k steps)" for mark in marks]
        rows = [(each.name, *(_mark_cell(each, mark) for mark in marks)) for each in experiments]
        blocks += [f"{title}:", _table(("experiment", *heads), rows)]
    return blocks


def _mark_cell(experiment: Experiment, mark: int) -> str:
    rewards = experiment.at(mark)
    point = original_point(experiment.game, experiment.layout, experiment.policy, mark)
    if not rewards:
        return ""
    text = f"{mean(rewards):.1f} ({len(rewards)})"
    if point is None:
        return text
    if differ(sample(rewards), point.sample):
        text = f"**{text}**"
    return f"{text}; {point.reward:.1f} ± {2 * point.reward_std:.1f}"


def _interval(values: Sequence[float]) -> str:
    bounds = interval(values)
    return f" [{bounds[0]:.1f}, {bounds[1]:.1f}]" if bounds else ""


def _percent(value: float) -> str:
    return f"{100 * value:.1f} %"


def _two_sigma(values: Sequence[float]) -> str:
    return f"{mean(values):.1f} ± {2 * stdev(values):.1f}"


def _figure(value: float | Sequence[float] | None) -> str:
    if isinstance(value, Sequence):
        return " ".join(f"{each:.0f}" for each in value)
    return "" if value is None else f"{value:.0f}" if abs(value) >= 1000 else f"{value:.3g}"


def _table(heads: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    return "\n".join("| " + " | ".join(cells) + " |" for cells in (heads, ["---"] * len(heads), *rows))
