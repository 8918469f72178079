"""What the paper's section VI-D says in words about trained policies, judged by an interval over policies.

Each statement has a figure per policy and a bound. It holds if the 95 % interval of the mean over policies is on its
side of the bound, and does not hold if it is on the other side. It is judged at the largest number of timesteps that
enough policies of the paper's layouts have trained, and decided by complete runs alone.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

from joybridge.compare import RunName
from joybridge.games.beastly_rivals import rules as rivals
from tools.paper.runs import COMPLETE, GAMES, LAYOUTS, MARK
from tools.paper.statistics import FAILS, HOLDS, UNDECIDED, UNTESTED, Sample, Verdict, margin, sample

Figures = Mapping[str, Any]  # of one trained policy, as in behavior.json
Policies = Sequence[tuple[str, Figures]]  # by "GAME/RUN"

BIRDS, RIVALS = GAMES
ENOUGH = 3  # policies whose mean is given an interval
DECISION_SECONDS = rivals.DECISION_TICKS * rivals.TICK
CLOCK_SECONDS = rivals.CLOCK_TICKS * rivals.TICK
TWICE = 2.0  # as often on a cleared side as else
HALF = 0.5  # as often as birds in full view; of the laps; of the clocks
FREQUENT = 2.0  # commands per second
PAPER = tuple(layout for layout in LAYOUTS if layout != "hybrid")  # the layouts that the paper compares
THRESHOLDS = tuple(layout for layout in PAPER if layout.startswith("threshold"))
LEAST = 1e-3  # that a ratio counts as; 0 has no logarithm


def _log(ratio: float) -> float:
    return math.log(max(ratio, LEAST))


RATIO = _log, math.exp  # for figures that are ratios: their mean is geometric


@dataclass(frozen=True)
class Statement:
    """The statement that a figure of policies is above a bound."""

    text: str
    game: str
    figure: Callable[[Figures], float | None]  # of one policy; None: what it is about did not happen
    bound: float
    scale: tuple[Callable[[float], float], Callable[[float], float]] = (float, float)  # and back
    less: tuple[str, ...] = ()  # layouts whose figures are less than those of the others, instead of above a bound


def measured(name: str) -> Callable[[Figures], float | None]:
    """Return the figure that is a measure as it is, by its name."""
    return lambda policy: policy[name]


def x_over_y(policy: Figures) -> float:
    """Return the mean speed of the crosshair along x over that along y."""
    return float(policy["abs_vx"] / policy["abs_vy"])


def clocks_survived(policy: Figures) -> float:
    """Return which fraction of the clocks was survived; the least that is possible where only deaths were counted."""
    if "clocks_survived" in policy:
        return float(policy["clocks_survived"])
    clocks = policy["episodes"] * policy["survival_seconds"] / CLOCK_SECONDS
    return max(0.0, float(2 - policy["episodes"] / clocks))  # each death, an episode more, in a clock of its own


def commands_per_second(policy: Figures) -> float:
    """Return how often move or blink is pressed."""
    return float(policy["commands_per_decision"] / DECISION_SECONDS)


STATEMENTS = (
    Statement("The crosshair moves faster along x than along y", BIRDS, x_over_y, 1.0, RATIO),
    Statement("The crosshair changes sides once its side is cleared", BIRDS, measured("side_changes"), TWICE, RATIO),
    Statement("Half hidden birds are hit", BIRDS, measured("half_hidden_hits"), HALF, RATIO),
    Statement(
        "The threshold approach skips dense regions of birds",
        BIRDS,
        measured("dense_hits"),
        1.0,
        RATIO,
        less=THRESHOLDS,
    ),
    Statement("Late in an episode, the cursor moves on a triangle", RIVALS, measured("late_triangles"), HALF),
    Statement("Most episodes survive the whole clock", RIVALS, clocks_survived, HALF),
    Statement("Commands are very frequent", RIVALS, commands_per_second, FREQUENT, RATIO),
)


def judge_statement(statement: Statement, policies: Policies) -> Verdict:
    """Judge a statement at the largest number of timesteps that enough policies have trained."""
    by_mark: dict[int, list[tuple[str, str, float]]] = {}  # name, layout and figure of each policy
    for name, layout, policy in _of_game(statement.game, policies):
        with suppress(KeyError):  # it was measured before there was this figure
            figure = statement.figure(policy)
            if figure is not None:
                by_mark.setdefault(round(policy["timesteps"] / MARK) * MARK, []).append((name, layout, figure))
    longer = ""  # policies that trained for longer, but are too few or not of the paper
    for mark, found in sorted(by_mark.items(), reverse=True):
        counted = [each for each in found if each[1] in PAPER]
        where = f"at {mark / 1e6:g} M"
        if estimate := _estimate(statement, [(layout, figure) for _, layout, figure in counted]):
            value, low, high = estimate
            effect = f"{value:.2f} [{low:.2f}, {high:.2f}]"
            evidence = f"{where} {effect} over {len(counted)} policies: {_list(counted)}{longer}"
            word = _word(statement, low, high) if mark >= COMPLETE else UNDECIDED  # it is said of trained policies
            return Verdict(word, evidence, where, runs=f"{len(counted)}", effect=effect)
        longer += f"; not counted, {where}: {_list(found)}"
    return Verdict(UNTESTED, f"needs `python -m tools.paper.behavior` on {ENOUGH} runs of the paper's approaches")


def _list(found: Sequence[tuple[str, str, float]]) -> str:
    return ", ".join(f"{name} {figure:.3g}" for name, _, figure in found)


def _of_game(game: str, policies: Policies) -> Iterator[tuple[str, str, Figures]]:
    """Yield name, layout and figures of the policies of a game, by name."""
    for name, policy in sorted(policies, key=lambda pair: pair[0]):
        with suppress(ValueError):  # a name that is not that of a run
            of, _, layout = RunName.parse(name).experiment.partition("/")
            if of == game:
                yield name.removeprefix(f"{game}/"), layout, policy


def _estimate(statement: Statement, figures: Sequence[tuple[str, float]]) -> tuple[float, float, float] | None:
    """Return the mean over policies with its 95 % interval, or None for too few.

    With `less`, it is the mean of its layouts over that of the others.
    """
    there, back = statement.scale
    groups: list[list[float]] = [[], []]
    for layout, figure in figures:
        groups[bool(statement.less) and layout not in statement.less].append(there(figure))
    if any(len(group) < ENOUGH for group in groups[: 1 + bool(statement.less)]):
        return None
    first = sample(groups[0])
    second = sample(groups[1]) if statement.less else Sample(0.0, 0.0, 1, 0)
    middle, half = first.mean - second.mean, margin(first, second)
    return back(middle), back(middle - half), back(middle + half)


def _word(statement: Statement, low: float, high: float) -> str:
    below, beyond = high < statement.bound, low > statement.bound
    if statement.less:
        below, beyond = beyond, below
    return HOLDS if beyond else FAILS if below else UNDECIDED
