"""The paper's claims one by one, and how each is judged from our runs and from the original's own logs.

A claim about scores is judged at the longest run that all experiments it names have reached, and before the
complete length only if the original's curves show it there already and to the end; else it has not been tested yet.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from statistics import geometric_mean, mean
from typing import Any

from tools.paper.original import original_ends, original_point, paper_figures
from tools.paper.runs import COMPLETE, LAYOUTS, Results, main_policy
from tools.paper.statistics import (
    FAILS,
    HOLDS,
    UNDECIDED,
    UNTESTED,
    Rule,
    Sample,
    Verdict,
    alike,
    beats,
    pooled,
    sample,
    steadier,
    trails,
)

POINTS = 0.01  # of click accuracy that make a difference
SMALLER = 0.9  # laps are smaller when the last third of the time is below this share of the first
RARE = 10.0  # blinks in 10 000 decisions
DECISION_SECONDS = 0.12
SOUGHT = 1.5  # times the share of time in the slow sphere that chance gives; the inverse is shunned

PAPER = [layout for layout in LAYOUTS if layout != "hybrid"]  # that the paper compares
Behavior = Mapping[str, Mapping[str, Any]]  # results/behavior.json: "GAME/FOLDER" -> figures


@dataclass(frozen=True)
class Claim:
    """What the paper says, and what is to be said of it."""

    text: str
    game: str
    judge: Callable[[Results, Behavior], Verdict]  # our runs
    logs: Verdict | None  # on the original's own logs; None: they do not tell


def make_claims() -> list[Claim]:
    """Return every claim of the paper that we know a rule for."""
    birds, rivals = "shooting_birds", "beastly_rivals"
    zero, tenth, half = thresholds = ("threshold-0.0", "threshold-0.1", "threshold-0.5")
    buckets = ("bucket-11", "bucket-3", "bucket-41")
    return [
        score("The bucket approach scores higher than the threshold approach", birds, beats, "bucket-11", zero),
        score("The bucket approach scores higher than the threshold approach", rivals, beats, "bucket-3", zero),
        stability("The bucket approach is more stable than the threshold approach", birds, buckets, thresholds),
        stability("The bucket approach is more stable than the threshold approach", rivals, buckets, thresholds),
        score("The bucket approach scores higher than the two agents", birds, beats, "bucket-11", "multiagent"),
        score("The bucket approach and the two agents score alike", rivals, alike, "bucket-3", "multiagent"),
        score("The two agents score higher than the threshold approach", birds, beats, "multiagent", zero),
        score("The two agents score higher than the threshold approach", rivals, beats, "multiagent", zero),
        score("Eleven values per axis score higher than 3 and 41", birds, beats, *buckets),
        score("No number of values per axis wins", rivals, alike, *buckets),
        accuracy("With 3 and 41 values clicks are as accurate as with 11", as_accurate, *buckets),
        accuracy("Bucket and the two agents click more accurately than threshold", less_accurate,
                 zero, "bucket-11", "multiagent"),
        score("Threshold 0.0 is the best threshold", birds, beats, *thresholds),
        score("Threshold 0.0 is the best threshold", rivals, beats, *thresholds),
        score("Threshold 0.5 scores lower than 0.0 (the paper: behaves like it, but worse)", birds, beats, zero, half),
        score("Threshold 0.1 is much weaker than the other two", birds, trails, tenth, zero, half),
        stability("Threshold 0.1 is very unstable", birds, (zero, half), (tenth,)),
        score("The thresholds score alike", rivals, alike, *thresholds),
        training_time("The two agents cost extra training time (the paper: more than 30 %)", birds,
                      "multiagent", "bucket-11"),
        training_time("The two agents cost extra training time (the paper: 20 %)", rivals, "multiagent", "bucket-3"),
        training_time("The largest bucket is slower (the paper: slightly)", birds, "bucket-41", "bucket-3"),
        training_time("The largest bucket is slower (the paper: slightly)", rivals, "bucket-41", "bucket-3"),
        Claim("Laps around the pitch are bigger early on and smaller later", rivals, judge_laps, None),
        Claim("Blinking hardly matters: it is almost never done", rivals, judge_blinks, None),
        Claim("The slow sphere hardly matters: it is neither sought nor shunned", rivals, judge_sphere, None),
    ]  # fmt: skip


def score(text: str, game: str, rule: Rule, *layouts: str) -> Claim:
    """Return a claim about mean rewards; layouts in the order of the rule."""
    return Claim(
        text, game, lambda results, _: _judge_rewards(results, game, layouts, rule, 1), _judge_logs(game, layouts, rule)
    )


def stability(text: str, game: str, first: Sequence[str], second: Sequence[str]) -> Claim:
    """Return the claim that runs of the first layouts scatter less than those of the second."""

    def rule(samples: Sequence[Sample]) -> str:
        return steadier(samples[: len(first)], samples[len(first) :])

    layouts = (*first, *second)
    return Claim(
        text, game, lambda results, _: _judge_rewards(results, game, layouts, rule, 2), _judge_logs(game, layouts, rule)
    )


def _judge_rewards(results: Results, game: str, layouts: Sequence[str], rule: Rule, least: int) -> Verdict:
    """Judge our runs at the longest length at which every layout has at least so many of them."""
    runs = {layout: results.get((game, layout, main_policy(layout))) for layout in layouts}
    lacking = [layout for layout, each in runs.items() if each is None or len(each.runs) < least]
    present = [each for each in runs.values() if each]
    if lacking:
        return Verdict(UNTESTED, f"needs {'runs' if least == 1 else f'at least {least} runs'} of {', '.join(lacking)}")
    common = [
        mark for mark in present[0].marks
        if all(len(each.at(mark)) >= least for each in present) and _log_samples(game, layouts, mark)
    ]  # fmt: skip
    if not common:
        return Verdict(UNTESTED, "needs runs that are long enough to compare")
    values, logs = [each.at(common[-1]) for each in present], _log_samples(game, layouts, common[-1])
    ours = [sample(each) for each in values]
    where = f"at {common[-1] / 1e6:g} M"
    figures = f"{where} {_list(layouts, ours)}; the original there {_list(layouts, logs)}"
    if common[-1] < COMPLETE and {rule(logs), rule(_log_samples(game, layouts, COMPLETE))} != {HOLDS}:
        return Verdict(UNTESTED, f"needs longer runs, as the original does not show it both then and later: {figures}")
    if least == 1:
        ours = [pooled(each, theirs) for each, theirs in zip(ours, logs, strict=True)]
    return Verdict(rule(ours), figures, where)


def _judge_logs(game: str, layouts: Sequence[str], rule: Rule) -> Verdict:
    """Judge the original's complete runs, ten of each experiment."""
    samples = _log_samples(game, layouts, COMPLETE)
    return Verdict(rule(samples), _list(layouts, samples))


def _log_samples(game: str, layouts: Sequence[str], mark: int) -> list[Sample]:
    """Return the original's samples at a mark; none unless it has figures there for all the layouts."""
    points = [original_point(game, layout, main_policy(layout), mark) for layout in layouts]
    return [p.sample for p in points if p] if all(points) else []


def _list(layouts: Sequence[str], samples: Sequence[Sample]) -> str:
    return ", ".join(
        f"{layout} {each.mean:.1f}" + (f" ± {each.spread:.1f}" if each.runs > 1 else "") + f" ({each.runs})"
        for layout, each in zip(layouts, samples, strict=True)
    )


def accuracy(text: str, rule: Callable[[Sequence[float]], str], *layouts: str) -> Claim:
    """Return a claim about click accuracy after complete runs, of which the original has no logs."""

    def judge(results: Results, _: Behavior) -> Verdict:
        runs = [results.get(("shooting_birds", layout, main_policy(layout))) for layout in layouts]
        values = [each.at(COMPLETE, "click_accuracy") if each else [] for each in runs]
        lacking = [layout for layout, each in zip(layouts, values, strict=True) if not each]
        figures = ", ".join(
            f"{layout} {100 * mean(each):.1f} % ({len(each)})"
            for layout, each in zip(layouts, values, strict=True) if each
        )  # fmt: skip
        if lacking:
            return Verdict(
                UNTESTED, f"needs complete runs of {', '.join(lacking)}" + (f"; {figures}" if figures else "")
            )
        printed = [f"{layout} {100 * paper_figures('shooting_birds', layout)['accuracy']:g} %" for layout in layouts]
        return Verdict(rule([mean(each) for each in values]), f"{figures}; in the paper {', '.join(printed)}")

    return Claim(text, "shooting_birds", judge, None)


def as_accurate(values: Sequence[float]) -> str:
    """Decide whether all are within a point of the first."""
    return FAILS if any(abs(value - values[0]) > POINTS for value in values) else HOLDS


def less_accurate(values: Sequence[float]) -> str:
    """Decide whether the first is more than a point below each of the others."""
    return HOLDS if min(values[1:]) - values[0] > POINTS else FAILS


def training_time(text: str, game: str, slow: str, fast: str) -> Claim:
    """Return the claim that one layout takes longer to train than another, beyond the noise.

    Our runs alone are compared turn by turn, those of one seed, which were made soon after one another: a machine may
    be faster at one time than at another.
    """
    layouts = (slow, fast)

    def judge(results: Results, _: Behavior) -> Verdict:
        experiments = [results.get((game, layout, main_policy(layout))) for layout in layouts]
        times = [{run.seed: run.complete_hours for run in each.alone} if each else {} for each in experiments]
        pairs = [(times[0][seed], times[1][seed]) for seed in times[0] if seed in times[1]]
        if len(pairs) < 2:
            return Verdict(UNTESTED, f"needs runs alone, for their speed, of {slow} and {fast}, at least 2 turns")
        ratios = sample([math.log(long / short) for long, short in pairs])
        hours = [geometric_mean(each) for each in zip(*pairs, strict=True)]
        return Verdict(beats([ratios, Sample(0.0, 0.0, len(pairs), 0)]), f"{compared(*hours)} ({len(pairs)})")

    def compared(long: float, short: float) -> str:
        return f"{slow} {long:.3g} h, {fast} {short:.3g} h: {100 * (long / short - 1):+.0f} %"

    ends = [original_ends(game, layout, main_policy(layout)) for layout in layouts]
    hours = [each.hours for each in ends if each]
    printed = compared(*(paper_figures(game, layout)["hours"] for layout in layouts))
    logs = f"{compared(*(mean(each) for each in hours))}; in the paper's chart {printed}"
    return Claim(text, game, judge, Verdict(beats([sample(each) for each in hours]), logs))


Shown = list[tuple[str, bool, bool]]  # of each policy: its figure, whether it shows what is claimed, whether complete


def judge_laps(_: Results, behavior: Behavior) -> Verdict:
    """Compare the laps' radius in the first and the last third of the time."""
    shown: Shown = []
    for name, policy in _trained(behavior).items():
        laps = policy["lap_radius"]
        if len(laps) < 3:  # it dies before there is a later
            continue
        end = max(seconds for seconds, _ in laps)
        early = mean(radius for seconds, radius in laps if seconds <= end / 3)
        late = mean(radius for seconds, radius in laps if seconds >= 2 * end / 3)
        shown.append((f"{name} {early:.1f} m, later {late:.1f} m", late < SMALLER * early, _complete(policy)))
    return _judge_shown(shown)


def judge_blinks(_: Results, behavior: Behavior) -> Verdict:
    """Count blinks in 10 000 decisions."""
    shown: Shown = []
    for name, policy in _trained(behavior).items():
        blinks = 1e4 * policy["blinks_per_episode"] / (policy["survival_seconds"] / DECISION_SECONDS)
        shown.append((f"{name} {blinks:.1f} in 10 000 decisions", blinks <= RARE, _complete(policy)))
    return _judge_shown(shown)


def judge_sphere(_: Results, behavior: Behavior) -> Verdict:
    """Compare the share of time in the slow sphere with that of chance, where the sphere slows the character."""
    shown: Shown = []
    for name, policy in _trained(behavior).items():
        if not name.startswith("multiagent"):  # in the two agents' scene the character is never slowed
            share, chance = policy["slow_share"], policy["slow_share_by_chance"]
            text = f"{name} {100 * share:.0f} %, by chance {100 * chance:.0f} %"
            shown.append((text, 1 / SOUGHT < share / chance < SOUGHT, _complete(policy)))
    return _judge_shown(shown)


def _trained(behavior: Behavior) -> dict[str, Mapping[str, Any]]:
    """Return the figures of the paper's approaches on Beastly Rivals, by layout and seed."""
    names = {name: name.removeprefix("beastly_rivals/") for name in sorted(behavior)}
    return {short: behavior[name] for name, short in names.items() if short.rpartition("-s")[0] in PAPER}


def _complete(policy: Mapping[str, Any]) -> bool:
    return int(policy["timesteps"]) >= COMPLETE


def _judge_shown(shown: Shown) -> Verdict:
    """Judge by whether all policies of complete runs show it, or none; others are only mentioned."""
    words = [holds for _, holds, complete in shown if complete]
    if not words:
        so_far = "; so far " + "; ".join(text for text, _, _ in shown) if shown else ""
        return Verdict(
            UNTESTED, f"needs `python -m tools.paper.behavior` on complete runs of the paper's approaches{so_far}"
        )
    word = HOLDS if all(words) else UNDECIDED if any(words) else FAILS
    return Verdict(word, "; ".join(text for text, _, complete in shown if complete), "at 30 M")
