"""The tables of the report, as Markdown."""

from collections.abc import Sequence
from statistics import mean, stdev

from joybridge.compare.estimators import holm
from joybridge.compare.page_parts import table
from tools.paper.claims import Behavior, Judged
from tools.paper.figures import TITLES
from tools.paper.original import TIMESTEPS_PER_STEP, original_ends, original_point, paper_figures
from tools.paper.runs import COMPLETE, MARK, Experiment, Results, Run, main_policy
from tools.paper.statistics import (
    FAILS,
    HOLDS,
    SIGNIFICANCE,
    UNDECIDED,
    differ,
    interquartile_mean,
    interval,
    sample,
    variance_p,
    welch_p,
)

MARKS = (300_000, 1_200_000, 1_500_000, 3_000_000, 15_000_000, COMPLETE)  # timesteps in the columns of `by_marks`
LAST_TEN = tuple(range(COMPLETE - 9 * MARK, COMPLETE + 1, MARK))
ENOUGH = 3  # complete runs of an experiment whose mean and variance are tested
COURSES = ("lap_radius",)  # figures over time, which only a plot can show
LAST = ("timesteps", "episodes")  # columns
INSIDE = "inside"
NONE = "There is no complete run yet."


def complete_experiments(results: Results) -> str:
    """Return a table of the complete runs of each experiment and the original's ten runs."""
    heads = ("experiment", "runs", "reward", "the original, ± 2 sd", "inside", "hours", "the original, hours")
    rows = []
    for experiment in results.values():
        runs = experiment.complete
        if runs and experiment.policy == main_policy(experiment.layout):
            ends = original_ends(experiment.game, experiment.layout, experiment.policy)
            rewards = [run.rows[COMPLETE]["reward"] for run in runs]
            lowest_to_highest = f" ({min(rewards):.1f} to {max(rewards):.1f})" if len(runs) > 1 else ""
            inside = sum(place(reward, ends.reward) == INSIDE for reward in rewards) if ends else 0
            rows.append(
                (
                    f"{TITLES[experiment.game]} {experiment.layout}",
                    f"{len(runs)}",
                    f"{mean(rewards):.1f}{lowest_to_highest}",
                    _two_sigma(ends.reward) if ends else "not in the paper",
                    f"{inside} of {len(runs)}" if ends else "",
                    f"{mean(run.hours for run in runs):.2f}",
                    f"{mean(ends.hours):.1f}" if ends else "",
                )
            )
    return table(heads, rows) if rows else NONE


def complete_runs(results: Results) -> str:
    """Return a table of every complete run and the original's ten runs."""
    heads = ("run", "reward", "the original", "place", "last ten marks", "the original", "hours", "the original, hours")
    rows = []
    for experiment in results.values():
        ends = original_ends(experiment.game, experiment.layout, experiment.policy)
        for run in experiment.complete:
            reward, last = run.rows[COMPLETE]["reward"], last_ten(run)
            rows.append(
                (
                    f"{TITLES[experiment.game]} {experiment.name}, seed {run.seed}",
                    f"{reward:.1f}",
                    _two_sigma(ends.reward) if ends else "",
                    place(reward, ends.reward) if ends else "not in the paper",
                    f"{last:.1f}",
                    _two_sigma(ends.last_ten) if ends else "",
                    f"{run.hours:.2f}",
                    f"{mean(ends.hours):.1f}" if ends else "",
                )
            )
    return table(heads, rows) if rows else NONE


def agreement(results: Results) -> str:
    """Return a table that compares our complete runs with the original's, of experiments with enough of ours."""
    heads = ("experiment", "our runs", "mean", "sd", "original's runs", "mean", "sd", "p of means", "p of variances")
    rows = []
    for experiment in results.values():
        ends = original_ends(experiment.game, experiment.layout, experiment.policy)
        if ends and len(experiment.complete) >= ENOUGH:
            ours, theirs = sample([last_ten(run) for run in experiment.complete]), sample(ends.last_ten)
            rows.append(
                (
                    f"{TITLES[experiment.game]} {experiment.name}",
                    f"{ours.runs}",
                    f"{ours.mean:.1f}",
                    f"{ours.std:.1f}",
                    f"{theirs.runs}",
                    f"{theirs.mean:.1f}",
                    f"{theirs.std:.1f}",
                    _p(welch_p(ours, theirs)),
                    _p(variance_p(ours, theirs)),
                )
            )
    return table(heads, rows) if rows else f"No experiment has {ENOUGH} complete runs yet."


def _p(value: float) -> str:
    return f"**{value:.3f}**" if value < SIGNIFICANCE else f"{value:.2f}"


def last_ten(run: Run) -> float:
    """Return the mean reward of the last ten marks of a complete run."""
    return mean(run.rows[mark]["reward"] for mark in LAST_TEN if mark in run.rows)


def place(value: float, others: Sequence[float]) -> str:
    """Return whether a value is inside, above or below the mean ± two standard deviations of others."""
    if abs(value - mean(others)) <= 2 * stdev(others):
        return INSIDE
    return "above" if value > mean(others) else "**below**"


def behaviors(behavior: Behavior) -> list[str]:
    """Return a table per game of what `tools.paper.behavior` measured, except for figures over time."""
    blocks = []
    for game, title in TITLES.items():
        chosen = {name: figures for name, figures in sorted(behavior.items()) if name.startswith(f"{game}/")}
        found = dict.fromkeys(key for figures in chosen.values() for key in figures if key not in COURSES)
        keys = sorted(found, key=lambda key: key in LAST)
        rows = [
            (name.removeprefix(f"{game}/"), *(_figure(figures.get(key)) for key in keys))
            for name, figures in chosen.items()
        ]
        if rows:
            blocks += [f"{title}:", table(("policy", *(key.replace("_", " ") for key in keys)), rows)]
    return blocks


def claims(judged: Sequence[Judged]) -> str:
    """Return a table of the claims with our verdict, the runs and the difference behind it, and the logs' verdict."""
    tested = [claim.here.p for claim in judged if claim.here.p is not None]
    corrected = iter(holm(tested))
    return table(
        ("", "the paper's claim", "game", "here", "runs", "difference, 95 %", "p", "p, Holm", "the original's logs"),
        [
            (
                f"{number}",
                claim.text,
                TITLES[claim.game],
                f"**{claim.here.word}** {claim.here.where}".strip(),
                claim.here.runs,
                claim.here.effect,
                *(("", "") if claim.here.p is None else (f"{claim.here.p:.2g}", f"{next(corrected):.2g}")),
                claim.logs.word if claim.logs else "no logs",
            )
            for number, claim in enumerate(judged, 1)
        ],
    )


def contradictions(judged: Sequence[Judged]) -> str:
    """Return a list of the claims that the original's own logs do not confirm."""
    said = {FAILS: "contradict", UNDECIDED: "do not decide"}
    return "\n".join(
        f"- The logs {said[claim.logs.word]} claim {number}, {TITLES[claim.game]}: {claim.logs.evidence}."
        for number, claim in enumerate(judged, 1)
        if claim.logs and claim.logs.word != HOLDS
    )


def evidence(judged: Sequence[Judged]) -> str:
    """Return a list of the figures behind the verdicts."""
    return "\n".join(
        f"{number}. Here: {claim.here.evidence}." + (f" Logs: {claim.logs.evidence}." if claim.logs else "")
        for number, claim in enumerate(judged, 1)
    )


def every_experiment(results: Results) -> str:
    """Return a table of every experiment after the last timestep of its runs."""
    heads = (
        "experiment",
        "timesteps",
        "runs",
        "reward",
        "IQM",
        "accuracy or length",
        "hours per run",
        "timesteps/s alone",
        "logs: reward",
        "logs: IQM",
        "logs: length",
        "paper: reward",
        "paper: accuracy or length",
        "paper: hours",
    )
    return table(
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
        f"{TITLES[game]} {experiment.name}",
        f"{mark / 1e6:g} M",
        f"{len(rewards)}",
        f"{mean(rewards):.1f}{_interval(rewards)}",
        f"{interquartile_mean(rewards):.1f}" if len(rewards) > 1 else "one run",
        _percent(second) if birds else f"{second:.0f}",
        f"{hours:.2f}",
        f"{COMPLETE / 3600 / mean(alone):.0f}" if alone else "",
        theirs + (_interval(ends.reward) if ends else ""),
        f"{interquartile_mean(ends.reward):.1f}" if ends else "",
        f"{point.length:.0f} ± {point.length_std:.0f}" if point and not birds else "",
        _figure(printed.get("reward")),
        (_percent(printed_second) if birds else f"{printed_second:.0f}") if printed_second else "",
        _figure(printed.get("hours")),
    )


def by_marks(results: Results) -> list[str]:
    """Return a table per game of the reward at some marks, in bold where it differs from the original's."""
    blocks = []
    for game, title in TITLES.items():
        experiments = [experiment for experiment in results.values() if experiment.game == game]
        marks = [mark for mark in MARKS if any(experiment.at(mark) for experiment in experiments)]
        heads = [f"{mark / 1e6:g} M ({mark // TIMESTEPS_PER_STEP // 1000} k steps)" for mark in marks]
        rows = [(each.name, *(_mark_cell(each, mark) for mark in marks)) for each in experiments]
        blocks += [f"{title}:", table(("experiment", *heads), rows)]
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
