"""Evaluation: play a run's policy for many episodes and say how well it does, with a confidence interval."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from joybridge.tensors import Array
from joybridge.v1 import bridge_pb2 as pb
from trainer.client import Session, describe
from trainer.config import Config, ConfigError
from trainer.metrics import Episodes, Row
from trainer.playing import Players, run_config

CONFIDENCE = 1.96  # standard errors in a 95 % interval


@dataclass(frozen=True)
class Evaluation:
    """One policy's episodes, means with half-widths of their 95 % confidence intervals."""

    transitions: int  # how long the policy had trained
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
    arenas = max(1, min(math.ceil(episodes / len(choices)), spec.max_arenas, 64))
    rounds = math.ceil(episodes / (arenas * len(choices)))
    finished: dict[str, list[Array]] = {}
    names: dict[str, list[str]] = {}
    transitions = 0
    for choice in choices:
        options = config.options | ({config.balance: choice} if config.balance and choice else {})
        say(f"{arenas} arenas × {rounds} episodes" + (f", {config.balance} {choice}" if choice else ""))
        with Session(
            address, config.game, arenas=arenas, seed=seed, options=options, parameters=config.parameters
        ) as session:
            players = Players(run, session.spec, arenas, seed, deterministic=deterministic)
            transitions = players.transitions
            for name, table in _play(players, session, rounds).items():
                finished.setdefault(name, []).append(table.finished)
                names[name] = ["reward", "length", *table.metrics]
    result = {}
    for name, tables in finished.items():
        # Every choice weighs the same, however many episodes it took.
        means = np.mean([table.mean(axis=0) for table in tables], axis=0)
        variances = [table.var(axis=0, ddof=1) / len(table) if len(table) > 1 else 0 * table[0] for table in tables]
        errors = CONFIDENCE * np.sqrt(np.sum(variances, axis=0)) / len(tables)
        by_choice = {choice: float(t[:, 0].mean()) for choice, t in zip(choices, tables, strict=True) if choice}
        result[name] = Evaluation(
            transitions, sum(map(len, tables)), dict(zip(names[name], means.tolist(), strict=True)),
            dict(zip(names[name], errors.tolist(), strict=True)), by_choice,
        )  # fmt: skip
    return result


def balanced_choices(config: Config, spec: pb.GameSpec) -> list[str]:
    """Return the choices to play equally often, or [""] where nothing is balanced. Raises ConfigError."""
    if config.balance is None or config.balance in config.options:
        return [""]
    option = next((option for option in spec.options if option.name == config.balance), None)
    if option is None:
        raise ConfigError(f"balance: {spec.name} has no option {config.balance!r}")
    return [choice for choice in option.choices if choice != option.default_choice]


def _play(players: Players, session: Session, rounds: int) -> dict[str, Episodes]:
    """Play `rounds` time limits, or where there is none until every lane has finished `rounds` episodes."""
    tables = {
        policy.name: Episodes(policy.lanes, [metric.name for metric in behaviour.metrics])
        for behaviour, group in zip(session.spec.behaviours, players.grouped, strict=True)
        for policy in group
    }
    players.begin(session.steps)
    limit = session.spec.max_episode_decisions * rounds
    left = {name: np.full(table.reward.shape, rounds) for name, table in tables.items()}
    decision = 0
    while decision < limit if limit else any(count.max() > 0 for count in left.values()):
        steps = session.step(players.act(session.steps))
        rewards = players.take(steps)
        for group, step in zip(players.grouped, steps, strict=True):
            for policy in group:
                table, count = tables[policy.name], left[policy.name]
                surplus = ~(count[step.ended] > 0) if not limit else np.zeros(len(step.ended), bool)
                table.add(step, rewards[policy.name])
                if surplus.any():  # lanes with short episodes must not count more often than others
                    table.finished = np.delete(
                        table.finished, len(table.finished) - len(surplus) + np.flatnonzero(surplus), 0
                    )
                count[step.ended] -= 1
        decision += 1
    return tables
