"""Training with PPO, from top to bottom: collect, estimate advantages, update, log, save.

A run consists of cycles. After each cycle all rollouts are empty, and the whole state of the run is captured, including
that of the simulators if the game has snapshots. If a run stops within a cycle, the resumed run continues from the last
captured state, with the same results as a run that never stopped.
"""

import math
import time
from collections.abc import Callable, Generator, Sequence
from contextlib import ExitStack, closing
from functools import partial
from pathlib import Path

import torch

from joybridge.trainer.actor import make_actors
from joybridge.trainer.checkpoint import has_checkpoint
from joybridge.trainer.config import Config, check_run, keep_config
from joybridge.trainer.errors import ConfigError
from joybridge.trainer.logger import Logger
from joybridge.trainer.metrics import Row
from joybridge.trainer.options import balanced_options
from joybridge.trainer.pipeline import collect, group_bounds, open_groups
from joybridge.trainer.policy import Policy
from joybridge.trainer.ppo.gae import gae
from joybridge.trainer.ppo.schedule import anneal
from joybridge.trainer.ppo.update import ppo_update
from joybridge.trainer.profiler import Profiler
from joybridge.trainer.recovery import Revive, recovering
from joybridge.trainer.run_state import RunState, capture, load_state
from joybridge.trainer.signals import uninterrupted
from joybridge.trainer.wire.client import describe

Report = Callable[[int, Row, Row | None], None]  # (timesteps, live figures, new row of the first policy or None)


def train(
    config: Config, run: Path, addresses: Sequence[str], *, resume: bool, report: Report, revive: Revive | None = None
) -> None:
    """Train `config` in the folder `run` on the simulators at `addresses`, from the beginning or a checkpoint.

    revive: called when a simulator is lost; returns the addresses of simulators that answer. Without it, training ends.

    Raises ConfigError, CheckpointError, StorageError, SimulatorError and DivergedError. The last state between two
    rollouts is saved on any exception.
    """
    torch.set_num_threads(1)  # two threads are slower than one when the simulator keeps the other core busy
    check_run(config, run, resume=resume)
    state = load_state(run) if has_checkpoint(run) else RunState()
    saved, saved_at = state.timesteps, time.monotonic()
    states = recovering(partial(play_and_learn, config, run, report), state, addresses, revive, config.restarts)
    try:
        with closing(states):
            for state in states:
                late = time.monotonic() - saved_at >= config.checkpoint_seconds
                if late or state.timesteps - saved >= config.checkpoint_interval:
                    state.save(run, config.keep)
                    saved, saved_at = state.timesteps, time.monotonic()
    finally:
        if state.timesteps:
            with uninterrupted():
                state.save(run, config.keep)


def play_and_learn(
    config: Config, run: Path, report: Report, addresses: Sequence[str], state: RunState
) -> Generator[RunState, None, None]:
    """Continue a run from a state, with new sessions. Yield the state after each cycle."""
    spec = describe(addresses[0], config.game, config.options)
    balanced_options(config, spec)  # only evaluation needs them, but an error then would come too late
    policies = [
        Policy(actor, spec.behaviors[actor.behavior], group_bounds(config))
        for actor in make_actors(config, spec, config.accelerator)
    ]
    cycle, stretch = rollout_cycle(policies)
    keep_config(config, run)
    timesteps, lanes = state.timesteps, policies[0].lanes
    with ExitStack() as opened:
        groups = open_groups(config, addresses, state.session_snapshots())
        for group in groups:
            opened.callback(group.session.close)
        loggers = [opened.enter_context(closing(Logger(run, policy.actor.name, timesteps))) for policy in policies]
        if state.arrays:
            state.restore(policies, loggers)
        if state.snapshots is None:
            for policy in policies:
                policy.begin([group.session.steps for group in groups])
        profiler = Profiler()
        while timesteps < config.end:
            for _ in range(cycle // stretch):
                for _ in collect(groups, policies, profiler, steps=stretch):
                    timesteps += lanes
                    profiler.timesteps += lanes
                    with profiler.measure("learn"):
                        for policy, logger in zip(policies, loggers, strict=True):
                            if policy.rollout.full:
                                logger.mean.add(learn(policy, timesteps / config.total_timesteps))
                    if timesteps // config.log_interval > (timesteps - lanes) // config.log_interval:
                        row = log(timesteps, policies, loggers, profiler)
                        report(timesteps, row, row)
            yield capture(timesteps, policies, loggers, groups)
            report(timesteps, profiler.live(), None)


def learn(policy: Policy, progress: float) -> Row:
    """Improve a policy on its full rollout, after a fraction `progress` of the run, and begin the next rollout.

    Return statistics, none if no decision was made in the rollout. Raises DivergedError.
    """
    config, rollout = policy.config, policy.rollout
    statistics: Row = {}
    if (decided := rollout.decided()).any():
        advantages = gae(
            rollout.rewards, rollout.values, policy.next_values(), rollout.terminated, rollout.truncated,
            rollout.final_values, decided,
            gamma=config.gamma, gae_lambda=config.gae_lambda, time_horizon=config.time_horizon,
        )  # fmt: skip
        statistics = ppo_update(
            policy.learner, rollout.batch(advantages, decided).to(policy.actor.accelerator),
            anneal(progress, config.learning_rate, config.clip_range, config.entropy_coef),
            epochs=config.epochs, minibatch_size=config.minibatch_size, rng=policy.shuffles(),
        )  # fmt: skip
        statistics["value"] = float(rollout.values[decided].mean())
    policy.restart()
    return statistics


def log(timesteps: int, policies: Sequence[Policy], loggers: Sequence[Logger], profiler: Profiler) -> Row:
    """Write a row of metrics for each policy; return that of the first."""
    times = profiler.summarize()
    rows = [
        logger.write(timesteps, policy.episodes.summarize(), times)
        for policy, logger in zip(policies, loggers, strict=True)
    ]
    return rows[0]


def rollout_cycle(policies: Sequence[Policy]) -> tuple[int, int]:
    """Return (cycle, stretch), both in decisions.

    All rollouts are empty again after every cycle, and a rollout gets full only at multiples of the stretch. Raises
    ConfigError if the rollouts are never empty together.
    """
    lengths = [policy.config.rollout_steps for policy in policies]
    cycle = max(lengths)
    for policy, length in zip(policies, lengths, strict=True):
        if cycle % length:
            raise ConfigError(
                f"policies.{policy.actor.name}.rollout_steps is {length}, which does not divide the longest, {cycle}"
            )
    return cycle, math.gcd(*lengths)
