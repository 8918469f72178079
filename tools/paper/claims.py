"""The paper's claims, each with a verdict on our runs and one on the original's own logs.

Claims about reward are judged at the largest number of timesteps that runs of all their layouts have reached. Before
the end of complete runs they are judged only if the original shows the claim there and at its end. What the paper says
in words of the behavior of trained policies is in `statements.py`, but for the claims in BEHAVIORS.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from statistics import geometric_mean, mean
from typing import Any

from joybridge.compare import RunName
from tools.paper.original import original_ends, original_point, paper_figures
from tools.paper.runs import COMPLETE, Experiment, Results, main_policy
from tools.paper.statements import DECISION_SECONDS, PAPER, STATEMENTS, judge_statement
from tools.paper.statistics import (
    FAILS,
    HOLDS,
    UNDECIDED,
    UNTESTED,
    Estimate,
    Rule,
    Sample,
    Verdict,
    above,
    above_effect,
    above_p,
    alike,
    alike_effect,
    alike_p,
    pooled,
    sample,
    steadier,
    steadier_effect,
    steadier_p,
)

BIRDS, RIVALS = "shooting_birds", "beastly_rivals"
ZERO, TENTH, HALF = THRESHOLDS = ("threshold-0.0", "threshold-0.1", "threshold-0.5")
B11, B3, B41 = BUCKETS = ("bucket-11", "bucket-3", "bucket-41")
TWO = "multiagent"
POINT = 0.01  # the smallest difference of click accuracies that counts
SMALLER = 0.9  # laps get smaller if the mean of the last third of the time is below this fraction of the first third's
RARE = 10.0  # blinks in 10 000 decisions
SOUGHT = 1.5  # times the time in the slow sphere by chance: more is sought, less than the inverse is avoided

P_VALUES: Mapping[Rule, Callable[[Sequence[Sample], Sequence[Sample]], float]] = {
    above: above_p,
    alike: alike_p,
    steadier: steadier_p,
}
EFFECTS: Mapping[Rule, Callable[[Sequence[Sample], Sequence[Sample]], Estimate]] = {
    above: above_effect,
    alike: alike_effect,
    steadier: steadier_effect,
}

Figures = Mapping[str, Any]  # of one trained policy
Behavior = Mapping[str, Figures]  # results/behavior.json, by "GAME/RUN"


@dataclass(frozen=True)
class Comparison:
    """The claim that a rule holds between the first layouts and the second."""

    text: str
    game: str
    rule: Rule
    first: tuple[str, ...]
    second: tuple[str, ...] = ()
    measure: str = "reward"  # or "accuracy", "hours"

    @property
    def layouts(self) -> tuple[str, ...]:
        """Return all layouts, the first ones first."""
        return *self.first, *self.second

    def decide(self, samples: Sequence[Sample]) -> str:
        """Apply the rule to a sample per layout."""
        return self.rule(samples[: len(self.first)], samples[len(self.first) :])

    def p(self, samples: Sequence[Sample]) -> float:
        """Return the p value of the rule's test."""
        return P_VALUES[self.rule](samples[: len(self.first)], samples[len(self.first) :])

    def effect(self, samples: Sequence[Sample]) -> Estimate:
        """Return what the rule's test is about, with its 95 % interval."""
        return EFFECTS[self.rule](samples[: len(self.first)], samples[len(self.first) :])


@dataclass(frozen=True)
class BehaviorClaim:
    """A claim about how trained policies behave in Beastly Rivals."""

    text: str
    show: Callable[[Figures], tuple[str, bool] | None]  # figures in words, and whether they show it; None: no answer
    layouts: tuple[str, ...]


@dataclass(frozen=True)
class Judged:
    """A claim with its verdicts."""

    text: str
    game: str
    here: Verdict
    logs: Verdict | None  # None: the original has no logs of it


def more_accurate(first: Sequence[Sample], second: Sequence[Sample]) -> str:
    """Decide whether each of the first means is more than a point above each of the second."""
    return HOLDS if min(a.mean for a in first) - max(b.mean for b in second) > POINT else FAILS


def as_accurate(first: Sequence[Sample], second: Sequence[Sample]) -> str:
    """Decide whether each of the second means is within a point of each of the first."""
    return HOLDS if all(abs(a.mean - b.mean) <= POINT for a in first for b in second) else FAILS


def laps(policy: Figures) -> tuple[str, bool] | None:
    """Compare the radius of laps in the first and in the last third of the time."""
    points = policy["lap_radius"]
    if len(points) < 3:  # its episodes are too short
        return None
    end = max(seconds for seconds, _ in points)
    early = mean(radius for seconds, radius in points if seconds <= end / 3)
    late = mean(radius for seconds, radius in points if seconds >= 2 * end / 3)
    return f"{early:.1f} m, later {late:.1f} m", late < SMALLER * early


def blinks(policy: Figures) -> tuple[str, bool]:
    """Count blinks in 10 000 decisions."""
    rate = 1e4 * policy["blinks_per_episode"] / (policy["survival_seconds"] / DECISION_SECONDS)
    return f"{rate:.1f} in 10 000 decisions", rate <= RARE


def sphere(policy: Figures) -> tuple[str, bool]:
    """Compare the fraction of time in the slow sphere with that by chance."""
    share, chance = policy["slow_share"], policy["slow_share_by_chance"]
    return f"{100 * share:.0f} %, by chance {100 * chance:.0f} %", 1 / SOUGHT < share / chance < SOUGHT


COMPARISONS = (
    Comparison("The bucket approach scores higher than the threshold approach", BIRDS, above, (B11,), (ZERO,)),
    Comparison("The bucket approach scores higher than the threshold approach", RIVALS, above, (B3,), (ZERO,)),
    Comparison("The bucket approach is more stable than the threshold approach", BIRDS, steadier, BUCKETS, THRESHOLDS),
    Comparison("The bucket approach is more stable than the threshold approach", RIVALS, steadier, BUCKETS, THRESHOLDS),
    Comparison("The bucket approach scores higher than the two agents", BIRDS, above, (B11,), (TWO,)),
    Comparison("The bucket approach and the two agents score alike", RIVALS, alike, (B3,), (TWO,)),
    Comparison("The two agents score higher than the threshold approach", BIRDS, above, (TWO,), (ZERO,)),
    Comparison("The two agents score higher than the threshold approach", RIVALS, above, (TWO,), (ZERO,)),
    Comparison("Eleven values per axis score higher than 3 and 41", BIRDS, above, (B11,), (B3, B41)),
    Comparison("No number of values per axis scores higher than the others", RIVALS, alike, BUCKETS),
    Comparison("3 and 41 values per axis click as accurately as 11", BIRDS, as_accurate, (B11,), (B3, B41), "accuracy"),
    Comparison(
        "Bucket and the two agents click more accurately than threshold",
        BIRDS,
        more_accurate,
        (B11, TWO),
        (ZERO,),
        "accuracy",
    ),
    Comparison("Threshold 0.0 is the best threshold", BIRDS, above, (ZERO,), (TENTH, HALF)),
    Comparison("Threshold 0.0 is the best threshold", RIVALS, above, (ZERO,), (TENTH, HALF)),
    Comparison("Threshold 0.5 scores lower than 0.0", BIRDS, above, (ZERO,), (HALF,)),
    Comparison("Threshold 0.1 is much weaker than the other two", BIRDS, above, (ZERO, HALF), (TENTH,)),
    Comparison("Threshold 0.1 is very unstable", BIRDS, steadier, (ZERO, HALF), (TENTH,)),
    Comparison("The thresholds score alike", RIVALS, alike, THRESHOLDS),
    Comparison("The two agents take longer to train (the paper: over 30 %)", BIRDS, above, (TWO,), (B11,), "hours"),
    Comparison("The two agents take longer to train (the paper: 20 %)", RIVALS, above, (TWO,), (B3,), "hours"),
    Comparison("The largest bucket takes longer to train (the paper: slightly)", BIRDS, above, (B41,), (B3,), "hours"),
    Comparison("The largest bucket takes longer to train (the paper: slightly)", RIVALS, above, (B41,), (B3,), "hours"),
)
BEHAVIORS = (
    BehaviorClaim("Laps around the pitch are large at first and become smaller", laps, PAPER),
    BehaviorClaim("Blinking hardly matters: policies almost never blink", blinks, PAPER),
    BehaviorClaim(
        "The slow sphere hardly matters: policies neither seek nor avoid it",
        sphere,
        tuple(layout for layout in PAPER if layout != "multiagent"),  # where the sphere does not slow the character
    ),
)


def judge_claims(results: Results, behavior: Behavior, shorter: Behavior | None = None) -> list[Judged]:
    """Judge every claim of the paper. shorter: further policies, of shorter trainings, for the statements."""
    policies = [*behavior.items(), *(shorter or {}).items()]
    judges = {"reward": _judge_rewards, "accuracy": _judge_accuracies, "hours": _judge_hours}
    return [
        *(Judged(c.text, c.game, judges[c.measure](c, results), judge_logs(c)) for c in COMPARISONS),
        *(Judged(claim.text, RIVALS, _judge_behavior(claim, behavior), None) for claim in BEHAVIORS),
        *(Judged(each.text, each.game, judge_statement(each, policies), None) for each in STATEMENTS),
    ]


def judge_logs(claim: Comparison) -> Verdict | None:
    """Judge the original's complete runs, ten per experiment; None for a measure that its logs do not hold."""
    if claim.measure == "reward":
        samples = _log_samples(claim, COMPLETE)
        return Verdict(claim.decide(samples), _list(claim.layouts, samples))
    if claim.measure == "hours":
        ends = [original_ends(claim.game, layout, main_policy(layout)) for layout in claim.layouts]
        hours = [sample(each.hours) for each in ends if each]
        printed = [paper_figures(claim.game, layout)["hours"] for layout in claim.layouts]
        logged = _hours(claim, [each.mean for each in hours])
        return Verdict(claim.decide(hours), f"{logged}; in the paper's chart {_hours(claim, printed)}")
    return None


def _judge_rewards(claim: Comparison, results: Results) -> Verdict:
    least = 2 if claim.rule is steadier else 1  # runs of each layout
    experiments = _experiments(claim, results)
    lacking = [name for name, each in zip(claim.layouts, experiments, strict=True) if len(each.runs) < least]
    if lacking:
        return Verdict(UNTESTED, f"needs {'runs' if least == 1 else f'at least {least} runs'} of {', '.join(lacking)}")
    common = [
        mark
        for mark in experiments[0].marks
        if all(len(each.at(mark)) >= least for each in experiments) and _log_samples(claim, mark)
    ]
    if not common:
        return Verdict(UNTESTED, "needs runs with a common number of timesteps")
    mark = common[-1]
    ours, logs = [sample(each.at(mark)) for each in experiments], _log_samples(claim, mark)
    where = f"at {mark / 1e6:g} M"
    evidence = f"{where} {_list(claim.layouts, ours)}; the original {_list(claim.layouts, logs)}"
    both = f"both {where} and at {COMPLETE / 1e6:g} M"
    if mark < COMPLETE and {claim.decide(logs), claim.decide(_log_samples(claim, COMPLETE))} != {HOLDS}:
        return Verdict(UNTESTED, f"needs longer runs, because the original does not show it {both}: {evidence}")
    if least == 1:
        ours = [pooled(each, theirs) for each, theirs in zip(ours, logs, strict=True)]
    effect = ("sd × " if claim.rule is steadier else "") + _estimate(claim.effect(ours))
    return Verdict(claim.decide(ours), evidence, where, claim.p(ours), _runs(ours), effect)


def _judge_accuracies(claim: Comparison, results: Results) -> Verdict:
    values = [each.at(COMPLETE, "click_accuracy") for each in _experiments(claim, results)]
    known = {layout: sample(each) for layout, each in zip(claim.layouts, values, strict=True) if each}
    evidence = ", ".join(f"{layout} {100 * each.mean:.1f} % ({each.runs})" for layout, each in known.items())
    lacking = [layout for layout in claim.layouts if layout not in known]
    if lacking:
        return Verdict(UNTESTED, f"needs complete runs of {', '.join(lacking)}" + (f"; {evidence}" if evidence else ""))
    printed = [f"{layout} {100 * paper_figures(claim.game, layout)['accuracy']:g} %" for layout in claim.layouts]
    verdict = f"{evidence}; in the paper {', '.join(printed)}"
    return Verdict(claim.decide(list(known.values())), verdict, runs=_runs(list(known.values())))


def _judge_hours(claim: Comparison, results: Results) -> Verdict:
    """Judge the ratio of times turn by turn: runs of one seed were made soon after one another.

    The machine's speed may change between turns.
    """
    times = [{run.seed: run.complete_hours for run in each.alone} for each in _experiments(claim, results)]
    turns = [(times[0][seed], times[1][seed]) for seed in times[0] if seed in times[1]]
    if len(turns) < 2:
        return Verdict(UNTESTED, f"needs at least 2 runs alone, for their speed, of {' and '.join(claim.layouts)}")
    ratios = sample([math.log(slow / fast) for slow, fast in turns])
    hours = [geometric_mean(each) for each in zip(*turns, strict=True)]
    pair = [ratios, Sample(0.0, 0.0, len(turns), 0)]
    low, middle, high = (100 * (math.exp(each) - 1) for each in sorted(claim.effect(pair)))
    return Verdict(
        claim.decide(pair),
        f"{_hours(claim, hours)} ({len(turns)})",
        p=claim.p(pair),
        runs=f"{len(turns)}, {len(turns)}",
        effect=f"{middle:+.0f} % [{low:+.0f}, {high:+.0f}]",
    )


def _judge_behavior(claim: BehaviorClaim, behavior: Behavior) -> Verdict:
    """Judge by whether all, some or none of the policies of complete runs show the claim."""
    shown: dict[str, tuple[str, bool]] = {}
    for name, policy in sorted(behavior.items()):
        with suppress(ValueError):  # a name that is not that of a run
            game, _, layout = RunName.parse(name).experiment.partition("/")
            answer = claim.show(policy) if game == RIVALS and layout in claim.layouts else None
            if answer and policy["timesteps"] >= COMPLETE:
                shown[name.removeprefix(f"{game}/")] = answer
    if not shown:
        return Verdict(UNTESTED, "needs `python -m tools.paper.behavior` on complete runs of the paper's approaches")
    words = [holds for _, holds in shown.values()]
    word = HOLDS if all(words) else UNDECIDED if any(words) else FAILS
    found = "; ".join(f"{name} {text}" for name, (text, _) in shown.items())
    effect = f"{sum(words)} of {len(words)}"
    return Verdict(word, found, f"at {COMPLETE / 1e6:g} M", runs=f"{len(words)}", effect=effect)


def _experiments(claim: Comparison, results: Results) -> list[Experiment]:
    """Return our runs per layout of a claim, none where there are none."""
    keys = [(claim.game, layout, main_policy(layout)) for layout in claim.layouts]
    return [results.get(key, Experiment(*key, ())) for key in keys]


def _log_samples(claim: Comparison, mark: int) -> list[Sample]:
    """Return the original's samples per layout at a mark; none unless it has figures there of all layouts."""
    points = [original_point(claim.game, layout, main_policy(layout), mark) for layout in claim.layouts]
    return [point.sample for point in points if point] if all(points) else []


def _list(layouts: Sequence[str], samples: Sequence[Sample]) -> str:
    return ", ".join(
        f"{layout} {each.mean:.1f}" + (f" ± {each.std:.1f}" if each.runs > 1 else "") + f" ({each.runs})"
        for layout, each in zip(layouts, samples, strict=True)
    )


def _runs(samples: Sequence[Sample]) -> str:
    return ", ".join(f"{each.runs}" for each in samples)


def _estimate(estimate: Estimate) -> str:
    value, low, high = estimate
    return f"{value:.1f} [{low:.1f}, {high:.1f}]"


def _hours(claim: Comparison, hours: Sequence[float]) -> str:
    (slow, fast), (long, short) = claim.layouts, hours
    return f"{slow} {long:.3g} h, {fast} {short:.3g} h: {100 * (long / short - 1):+.0f} %"
