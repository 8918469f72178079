"""Evaluation: play a run's policy for many episodes and say how well it does, with a confidence interval."""

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from joybridge.contract.tensors import Array
from joybridge.trainer.config import Config, ConfigError
from joybridge.trainer.metrics import Episodes, Row
from joybridge.trainer.playing import Players, run_config
from joybridge.trainer.wire.client import describe
from joybridge.trainer.wire.shards import Shards
from joybridge.v1 import bridge_pb2 as pb

CONFIDENCE = 1.96  # standard errors in a 95 % interval


@dataclass(frozen=True)
class Evaluation:
    """One policy's episodes, means with half-widths of their 95 % confidence intervals."""

    timesteps: int  # how long the policy had trained
    episodes: int
    means: Row
    half_widths: Row
    by_choice: dict[str, float]  # mean reward under each choice of the balanced option


def evaluate(
    run: Path, address: str, *, episodes: int, seed: int, deterministic: bool, say: Callable[[str], None]
) -> dict[str, Evaluation]:
    """Play at least `episodes` episodes of a run's policy; return an Evaluation per policy.

    Where the configuration names an option to balance, every choice of it but the default is played equally
    often. Where episodes have a common time limit, whole limits are played and every episode counts, as in
    the original's figures. Raises SimulatorError, CheckpointError or ConfigError.
    """
    config = run_config(run)
    spec = describe(address, config.game, config.options)
    choices = balanced_choices(config, spec)
    each = max(1, min(math.ceil(episodes / len(choices)), spec.max_arenas, 64))
    rounds = math.ceil(episodes / (each * len(choices)))
    arenas = each * len(choices)
    say(
        f"{arenas} arenas × {rounds} rounds" + (f", as many for each {config.evaluate_over}" if choices != [""] else "")
    )
    options = [
        config.options | ({config.evaluate_over: choice} if config.evaluate_over and choice else {})
        for choice in choices
    ]
    simulators = Shards(
        [address] * len(choices), config.game, arenas=arenas, seed=seed, options=options, parameters=config.parameters
    )
    players = Players(run, spec, arenas, seed, deterministic=deterministic)
    try:
        tables = _play(players, simulators, rounds, say)
    finally:
        simulators.close()
    return {name: _summarise(table, choices, players) for name, table in tables.items()}


def _summarise(table: Episodes, choices: list[str], players: Players) -> Evaluation:
    """Return means in which every choice weighs the same, however many episodes it took."""
    choice_of = table.finished[:, 0].astype(int) * len(choices) // len(table.reward)
    groups = [table.finished[choice_of == index, 1:] for index in range(len(choices))]
    means = np.mean([group.mean(axis=0) for group in groups], axis=0)
    variances = [group.var(axis=0, ddof=1) / len(group) if len(group) > 1 else 0 * group[0] for group in groups]
    errors = CONFIDENCE * np.sqrt(np.sum(variances, axis=0)) / len(groups)
    names = ["reward", "length", *table.metrics]
    return Evaluation(
        timesteps=players.timesteps,
        episodes=len(table.finished),
        means=dict(zip(names, means.tolist(), strict=True)),
        half_widths=dict(zip(names, errors.tolist(), strict=True)),
        by_choice={choice: float(g[:, 0].mean()) for choice, g in zip(choices, groups, strict=True) if choice},
    )


def balanced_choices(config: Config, spec: pb.GameSpec) -> list[str]:
    """Return the choices to play equally often, or [""] where nothing is balanced. Raises ConfigError."""
    if config.evaluate_over is None or config.evaluate_over in config.options:
        return [""]
    option = next((option for option in spec.options if option.name == config.evaluate_over), None)
    if option is None:
        raise ConfigError(f"evaluate_over: {spec.name} has no option {config.evaluate_over!r}")
    choices = [choice for choice in option.choices if choice != option.default_choice]
    if not choices:
        raise ConfigError(
            f"evaluate_over: option {config.evaluate_over!r} of {spec.name} has no choice but its default"
        )
    return choices


def _play(players: Players, simulators: Shards, rounds: int, say: Callable[[str], None]) -> dict[str, Episodes]:
    """Play `rounds` time limits, or where there is none until every lane has finished `rounds` episodes."""
    tables = {policy.name: Episodes(policy.lanes, policy.metrics) for policy in players.policies}
    players.begin(simulators.steps)
    limit = simulators.spec.max_episode_decisions
    for decision in itertools.count(1):
        steps = simulators.step(players.act(simulators.steps))
        for policy, rewards in zip(players.policies, players.take(steps), strict=True):
            tables[policy.name].add(steps[policy.behavior], rewards)
        if decision % 1000 == 0:
            say(f"{decision} decisions")
        if decision >= limit * rounds if limit else all(_episodes(t).min() >= rounds for t in tables.values()):
            break
    if not limit:  # lanes with short episodes must not count more often than others
        for table in tables.values():
            table.finished = _first(table.finished, rounds)
    return tables


def _episodes(table: Episodes) -> Array:
    """Return the finished episodes of each lane."""
    return np.bincount(table.finished[:, 0].astype(int), minlength=len(table.reward))


def _first(finished: Array, rounds: int) -> Array:
    """Return the first `rounds` episodes of each lane."""
    seen: dict[int, int] = {}
    keep = []
    for row, lane in enumerate(finished[:, 0].astype(int)):
        seen[lane] = seen.get(lane, 0) + 1
        if seen[lane] <= rounds:
            keep.append(row)
    return finished[keep]
