"""Training with PPO, from top to bottom: collect, estimate advantages, update, log, save.

A run consists of cycles. After each cycle all rollouts are empty, and the whole state of the run is captured, including
that of the simulators if the game has snapshots. If a run stops within a cycle, the resumed run continues from the last
captured state, with the same results as a run that never stopped.
"""

import math
import time
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path

from joybridge.client.sharded_session import single_sessions
from joybridge.client.signals import uninterrupted
from joybridge.config.config import Config
from joybridge.config.errors import ConfigError, DivergedError
from joybridge.config.game_settings import drawn
from joybridge.config.metrics import Row, is_trainers
from joybridge.demonstrations.cloning import demonstrate
from joybridge.policy.actor import make_actors
from joybridge.policy.config_fit import fitting_spec
from joybridge.policy.policy import Policy
from joybridge.policy.stratify import balanced_options
from joybridge.ppo.gae import gae
from joybridge.ppo.schedule import anneal
from joybridge.ppo.threads import use_one_thread
from joybridge.ppo.update import ppo_update
from joybridge.run.advice import Adviser
from joybridge.run.checkpoint import best_score, has_checkpoint
from joybridge.run.collect import Group, collect, group_bounds, open_groups
from joybridge.run.curriculum import Curriculum
from joybridge.run.folder import check_run, keep_config, keep_spec
from joybridge.run.logger import Logger
from joybridge.run.profiler import Profiler
from joybridge.run.recovery import Revive, recovering
from joybridge.run.run_state import RunState, capture, load_state, take_weights
from joybridge.v1 import bridge_pb2 as pb

Report = Callable[[int, Row, Row | None], None]  # (timesteps, live figures, new row of the first policy or None)


def train(
    config: Config, run: Path, addresses: Sequence[str], *, resume: bool, report: Report, revive: Revive | None = None,
    say: Callable[[str], None] = print, record_faults: bool = False,
) -> None:  # fmt: skip
    """Train `config` in the folder `run` on the simulators at `addresses`, from the beginning or a checkpoint.

    revive: called when a simulator is lost; returns the addresses of simulators that answer. Without it, training ends.
    say: called with remarks on the run, a line each. record_faults: write what led to a fault of a simulator, or to an
    update that diverged, into the folder faults of the run.

    Raises ConfigError, CheckpointError, StorageError, SimulatorError and DivergedError. The last state
    between two rollouts is saved on any exception.
    """
    use_one_thread()
    check_run(config, run, resume=resume)
    state = load_state(run) if has_checkpoint(run) else RunState()
    saved, saved_at = state.timesteps, time.monotonic()
    highest, best = best_score(run), None
    states = recovering(
        partial(play_and_learn, config, run, report, say, record_faults), state, addresses, revive,
        config.restarts,
    )  # fmt: skip
    try:
        with closing(states):
            for state in states:
                if state.score is not None and (highest is None or state.score > highest):
                    highest, best = state.score, state
                late = time.monotonic() - saved_at >= config.checkpoint_seconds
                if late or state.timesteps - saved >= config.checkpoint_interval:
                    save(state, best, run, config.keep)
                    saved, saved_at, best = state.timesteps, time.monotonic(), None
    finally:
        if state.timesteps:
            with uninterrupted():
                save(state, best, run, config.keep)


def play_and_learn(
    config: Config, run: Path, report: Report, say: Callable[[str], None], record_faults: bool,
    addresses: Sequence[str], state: RunState,
) -> Generator[RunState, None, None]:  # fmt: skip
    """Continue a run from a state, with new sessions. Yield the state after each cycle."""
    spec = fitting_spec(addresses[0], config)
    balanced_options(config, spec)  # only evaluation needs them, but an error then would come too late
    policies = [
        Policy(actor, spec.behaviors[actor.behavior], group_bounds(config), drawn_parameters(config, spec))
        for actor in make_actors(config, spec, config.accelerator)
    ]
    cycle, stretch = rollout_cycle(policies)
    for remark in demonstrate(policies, config, run, spec, resumed=state.timesteps > 0):
        say(remark)
    metric, sign = best_metric(config, policies[0])
    keep_config(config, run)
    keep_spec(spec, run)
    timesteps, lanes = state.timesteps, policies[0].lanes
    curriculum = Curriculum(config, spec, policies)
    state.restore_lesson(curriculum)
    with ExitStack() as opened:
        snapshots = state.session_snapshots()
        groups = open_groups(config, addresses, snapshots, curriculum.parameters, curriculum.distributions)
        for group in groups:
            opened.callback(group.session.close)
        if record_faults:
            opened.enter_context(recording(groups, run / "faults"))
        loggers = [opened.enter_context(closing(Logger(run, policy.actor.name, timesteps))) for policy in policies]
        if state.arrays:
            state.restore(policies, loggers, groups)
        elif config.weights_from:
            trained = take_weights(policies, Path(config.weights_from))
            say(f"begins with the policies of {config.weights_from} after {trained:,} timesteps")
        if state.snapshots is None:
            for policy in policies:
                policy.begin([group.session.steps for group in groups])
        advisers = [Adviser(policy, spec.behaviors[policy.actor.behavior]) for policy in policies]
        profiler = Profiler()
        report(timesteps, profiler.live(), None)
        say_lesson(curriculum, say)
        while timesteps < config.end:
            score = None
            for _ in range(cycle // stretch):
                for _ in collect(groups, policies, profiler, steps=stretch):
                    timesteps += lanes
                    profiler.timesteps += lanes
                    curriculum.watch()
                    with profiler.measure("learn"):
                        for policy, logger, adviser in zip(policies, loggers, advisers, strict=True):
                            if policy.rollout.full:
                                for remark in adviser.look():
                                    say(remark)
                                progress = timesteps / config.total_timesteps
                                logger.mean.add(learn(policy, progress, alone=config.cloning == "alone"))
                    if timesteps // config.log_interval > (timesteps - lanes) // config.log_interval:
                        row = log(timesteps, policies, loggers, profiler, curriculum.row())
                        report(timesteps, row, row)
                        score = sign * row[metric] if metric in row else score
                    elif profiler.due():
                        report(timesteps, profiler.live(), None)
            end_lesson(curriculum, timesteps / config.total_timesteps, groups, say)
            yield replace(capture(timesteps, policies, loggers, groups, curriculum), score=score)
            report(timesteps, profiler.live(), None)


@contextmanager
def recording(groups: Sequence[Group], folder: Path) -> Iterator[None]:
    """Record the faults of all sessions in the block, and what led to an update that diverged."""
    sessions = [session for group in groups for session in single_sessions(group.session)]
    for session in sessions:
        session.record_faults(folder)
    try:
        yield
    except DivergedError as error:
        for session in sessions:
            session.write_fault(str(error))
        raise


def save(state: RunState, best: RunState | None, run: Path, keep: int) -> None:
    """Write a checkpoint, and the best one if it is a new one. Raises StorageError."""
    state.save(run, keep)
    if best is not None:
        best.save_as_best(run)


def best_metric(config: Config, policy: Policy) -> tuple[str, int]:
    """Return the metric that marks the best checkpoint, and 1 if its highest value does, -1 if its lowest.

    It is one of the rows of `policy`. Raises ConfigError.
    """
    metric = config.best.removeprefix("-")
    known = ["reward", "length", *policy.episodes.metrics]
    if metric not in known and not is_trainers(metric):
        raise ConfigError(f"best: there is no metric {metric!r}; {policy.actor.name} has {', '.join(known)}")
    return metric, -1 if config.best.startswith("-") else 1


def learn(policy: Policy, progress: float, *, alone: bool = False) -> Row:
    """Improve a policy on its full rollout, after a fraction `progress` of the run, and begin the next rollout.

    alone: demonstrations, if there are any, replace PPO, which then only teaches the critic.

    Return statistics, none if no decision was made in the rollout. Raises DivergedError.
    """
    config, rollout = policy.config, policy.rollout
    statistics: Row = {}
    if (decided := rollout.decided()).any():
        advantages = gae(
            policy.rewards(decided), rollout.values, policy.next_values(), rollout.terminated, rollout.truncated,
            rollout.final_values, decided,
            gamma=config.gamma, gae_lambda=config.gae_lambda, time_horizon=config.time_horizon,
        )  # fmt: skip
        batch = rollout.batch(advantages, decided).to(policy.actor.accelerator)
        coefficients = anneal(progress, config)
        try:
            statistics = ppo_update(
                policy.learner, batch, coefficients,
                epochs=config.epochs, minibatch_size=config.minibatch_size,
                rng=policy.shuffles(), max_grad_norm=config.max_grad_norm, target_kl=config.target_kl,
                cloning=policy.cloning(progress, alone=alone),
            )  # fmt: skip
        except DivergedError as error:
            raise DivergedError(f"after update {policy.updates + 1:,}, {error}") from None
        statistics["value"] = float(rollout.values[decided].mean())
    policy.restart()
    return statistics


def say_lesson(curriculum: Curriculum, say: Callable[[str], None]) -> None:
    """Tell which lesson it is, if there are any."""
    if heading := curriculum.heading():
        say(heading)


def end_lesson(
    curriculum: Curriculum, progress: float, groups: Sequence[Group], say: Callable[[str], None]
) -> None:  # fmt: skip
    """Begin the next lesson in all sessions if the present one is over, after a fraction `progress` of the run."""
    if curriculum.advance(progress):
        say_lesson(curriculum, say)
        for group in groups:
            group.session.distribute(curriculum.distributions)


def drawn_parameters(config: Config, spec: pb.GameSpec) -> dict[int, str]:
    """Return the parameters that are drawn at each episode, in any lesson, by their place in the spec."""
    names = {name for lesson in config.curriculum for name in lesson.parameters} | drawn(config.parameters).keys()
    return {index: one.name for index, one in enumerate(spec.parameters) if one.name in names}


def log(timesteps: int, policies: Sequence[Policy], loggers: Sequence[Logger], profiler: Profiler, lesson: Row) -> Row:
    """Write a row of metrics for each policy; return that of the first. lesson: the column of the curriculum."""
    times = profiler.summarize()
    rows = [
        logger.write(timesteps, lesson | policy.episodes.summarize(), times)
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
