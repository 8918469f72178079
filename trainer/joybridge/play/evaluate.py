"""Evaluation: play the policies of a run for many episodes; mean results with confidence intervals."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from joybridge.client.sharded_session import single_sessions
from joybridge.config.errors import ConfigError
from joybridge.config.metrics import Row
from joybridge.contract.tensors import Array
from joybridge.play.input_statistics import InputMeasures, Inputs
from joybridge.play.playing import Change, Play, PlaySpec, open_play
from joybridge.play.text_table import aligned
from joybridge.policy.episodes import Episodes, equal_shares
from joybridge.progress import Progress

CONFIDENCE = 0.95  # of intervals


@dataclass(frozen=True)
class Evaluation:
    """One policy's episodes, means with half-widths of their 95 % confidence intervals."""

    timesteps: int  # how long the policy had trained
    episodes: int
    means: Row
    half_widths: Row  # NaN where a single episode does not say how they differ
    returns: list[float]  # of every episode, lane by lane
    by_choice: dict[str, float]  # mean reward under each choice of the option `stratify_by`
    changed: dict[str, Change]  # options and parameters that differ from the training, as in "parameters.size"
    behavior: str  # which the policy plays, or a part of
    inputs: Inputs | None  # what the agents of this behavior did with their devices; None: not measured
    random: bool = False  # chance has acted, and not the policy

    def as_data(self) -> dict[str, Any]:
        """Return everything as JSON has it, with null for a half-width that is not known."""
        known = {name: None if math.isnan(half) else half for name, half in self.half_widths.items()}
        return asdict(self) | {"half_widths": known}

    def half_width(self, metric: str) -> str:
        """Return the half-width of the interval of a metric as text, "?" where it is not known."""
        half = self.half_widths[metric]
        return "?" if math.isnan(half) else f"{half:.3f}"


def evaluate(
    plays: PlaySpec, *, episodes: int, say: Callable[[str], None], demos: Path | None = None, inputs: bool = False
) -> dict[str, Evaluation]:
    """Play a number of episodes of a run's policies; return an Evaluation per policy.

    demos: record what is played in this folder. inputs: measure what the agents do with their devices. Of an arena
    with others, only the seat that they do not hold counts.

    Where the configuration names an option in `stratify_by`, every choice of it but the default is played equally
    often. How many episodes of an arena count is fixed beforehand, so short ones count no more often than long ones.
    Each agent of an arena has its own episodes. Raises SimulatorError, CheckpointError, StorageError or ConfigError.
    """
    with open_play(plays, episodes=episodes) as play:
        if episodes < (least := len(play.choices)):
            by = play.config.stratify_by
            raise ConfigError(f"got {episodes} episodes, expected at least one for each of the {least} choices of {by}")
        actions = (
            "the most probable actions"
            if plays.deterministic
            else "sampled actions (--deterministic: the most probable)"
        )
        say(play.heading("random play") if plays.random else play.heading(actions=actions))
        if demos:
            say(f"recorded in {demos}")
            arena = 0
            for session in single_sessions(play.session):
                shown, arenas = session.record_demonstration(demos), slice(arena, arena := arena + session.arenas)
                if plays.others:
                    shown.hold([np.flatnonzero(_of_arenas(held, play.arenas, arenas)).tolist() for held in play.held])
        balanced = f", as many for each {play.config.stratify_by}" if len(play.choices) > 1 else ""
        say(f"{episodes} episodes in {play.arenas} arenas{balanced}")
        spec, behaviors = play.spec, {player.actor.behavior: player.lanes for player in play.players}
        seconds = spec.tick_seconds * spec.decision_interval
        measured = [
            (index, InputMeasures(spec.behaviors[index], seconds, lanes))
            for index, lanes in behaviors.items()
            if inputs
        ]
        tables = _play(play, equal_shares(episodes, play.arenas, len(play.choices)), say, measured)
    if unseated := [name for name, table in tables.items() if not len(table.finished)]:
        raise ConfigError(
            f"in {episodes} episodes, others have held all seats of {', '.join(unseated)}; play more, with --episodes"
        )
    results = {index: measures.result() for index, measures in measured}
    return {
        player.actor.name: replace(
            _summarize(tables[player.actor.name], play, player.actor.behavior, results), random=plays.random
        )
        for player in play.players
    }


def _of_arenas(lanes: Array, arenas: int, part: slice) -> Array:
    """Return the values [lanes] of some of all arenas."""
    values: Array = lanes.reshape(arenas, -1)[part].reshape(-1)
    return values


def _summarize(table: Episodes, play: Play, behavior: int, inputs: Mapping[int, Inputs]) -> Evaluation:
    """Return means in which every choice weighs the same, however many episodes it took."""
    choices = play.choices
    choice_of = table.finished[:, 0].astype(int) * len(choices) // len(table.reward)
    groups = [table.finished[choice_of == index, 1:] for index in range(len(choices))]
    matches = _matches(table.finished, len(table.reward) // play.arenas)
    match_of = matches[:, 0].astype(int) * len(choices) // len(table.reward)
    half_widths = _half_widths([matches[match_of == index, 1:] for index in range(len(choices))])
    means = np.mean([group.mean(axis=0) for group in groups], axis=0)
    names = ["reward", "length", *table.metrics]
    return Evaluation(
        timesteps=play.timesteps,
        episodes=len(table.finished),
        means=dict(zip(names, means.tolist(), strict=True)),
        half_widths=dict(zip(names, half_widths.tolist(), strict=True)),
        returns=table.finished[:, 1].tolist(),
        by_choice={choice: float(g[:, 0].mean()) for choice, g in zip(choices, groups, strict=True) if choice},
        changed=play.changed,
        behavior=play.spec.behaviors[behavior].name,
        inputs=inputs.get(behavior),
    )


def _matches(finished: Array, agents: int) -> Array:
    """Return the means of the rows of each match, whose agents are not independent of each other.

    finished: a row per episode, its lane first. agents: of an arena, whose lanes are side by side.
    """
    if agents == 1:
        return finished
    lanes = finished[:, 0].astype(int)
    order = np.argsort(lanes, kind="stable")
    _, begins, counts = np.unique(lanes[order], return_index=True, return_counts=True)
    episodes = np.empty(len(lanes), int)
    episodes[order] = np.arange(len(lanes)) - np.repeat(begins, counts)
    _, match = np.unique(lanes // agents * len(lanes) + episodes, return_inverse=True)
    sums = np.zeros((match.max() + 1, finished.shape[1]))
    np.add.at(sums, match, finished)
    means: Array = sums / np.bincount(match)[:, None]
    return means


def _half_widths(groups: Sequence[Array]) -> Array:
    """Return half-widths of the intervals of the mean over groups of their means, by the t distribution.

    groups: rows of results. The degrees of freedom are those of Welch and Satterthwaite. NaN where a group has one row.
    """
    from scipy.stats import t  # which takes a third of a second, and a command may end before

    if min(map(len, groups)) < 2:
        return np.full(groups[0].shape[1], np.nan)
    variances = np.array([group.var(axis=0, ddof=1) / len(group) for group in groups])
    whole = variances.sum(axis=0)
    squares = sum(part**2 / (len(group) - 1) for part, group in zip(variances, groups, strict=True))
    freedom = np.divide(whole**2, squares, out=np.ones_like(whole), where=squares > 0)
    half_widths: Array = t.ppf((1 + CONFIDENCE) / 2, freedom) * np.sqrt(whole) / len(groups)
    return half_widths


def summary(evaluations: Mapping[str, Evaluation]) -> str:
    """Return the results of all policies as lines to read."""
    lines = []
    for name, result in evaluations.items():
        played = "of random play" if result.random else f"after {result.timesteps:,} timesteps"
        lines.append(f"{name}: {result.episodes} episodes {played}, mean and 95 % confidence")
        lines += [f"  {metric:<16} {mean:10.3f} ± {result.half_width(metric)}" for metric, mean in result.means.items()]
        if result.by_choice:
            lines.append("  reward by choice " + "  ".join(f"{c}: {mean:.1f}" for c, mean in result.by_choice.items()))
    return "\n".join(lines)


def inputs_table(results: Mapping[str, Mapping[str, Evaluation]]) -> str:
    """Return the measures of inputs as lines to read: a column per key of `results`, each of which has all policies."""
    behaviors: dict[str, dict[str, Inputs]] = {}
    for key, evaluations in results.items():
        for result in evaluations.values():
            if result.inputs:
                behaviors.setdefault(result.behavior, {})[key] = result.inputs
    lines = []
    for behavior, played in behaviors.items():
        first = next(iter(played.values()))
        fewest = min(inputs.decisions for inputs in played.values())
        clock = f"{first.decision_seconds:g} s" if first.decision_seconds else "no fixed length"
        pointers = "".join(f", {name} as {sets}" for name, sets in first.pointers.items())
        lines.append(f"inputs of {behavior}: at least {fewest:,} decisions of {clock}{pointers}")
        names = list(dict.fromkeys(name for inputs in played.values() for name in inputs.measures))
        rows = [[name, *(_cell(inputs.measures.get(name)) for inputs in played.values())] for name in names]
        if len(played) > 1:
            rows.insert(0, ["", *played])
        lines += [f"  {line}" for line in aligned(rows)]
    return "\n".join(lines)


def _cell(value: float | None) -> str:
    return "–" if value is None else f"{value:.3f}"


def _play(
    play: Play, shares: Array, say: Callable[[str], None], measured: Sequence[tuple[int, InputMeasures]]
) -> dict[str, Episodes]:
    """Play until every arena has finished its share of episodes; return these."""
    tables = {player.actor.name: Episodes(player.lanes, player.actor.metrics) for player in play.players}
    progress = Progress(say)
    for number, decision in enumerate(play.decisions(), 1):
        for player, rewards in zip(play.players, decision.rewards, strict=True):
            behavior = player.actor.behavior
            tables[player.actor.name].add(decision.after[behavior], rewards, played=play.held[behavior])
        for index, measures in measured:
            measures.add(decision.before[index], decision.acts[index], decision.after[index])
        progress.report(f"{number:,} decisions")
        if all(tables[player.actor.name].has(shares, play.held[player.actor.behavior]) for player in play.players):
            break
    for table in tables.values():
        table.keep(shares)
    return tables
