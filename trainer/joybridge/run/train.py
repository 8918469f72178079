"""Training with PPO, from top to bottom: collect, learn, log, save.

A run consists of cycles. After each cycle all rollouts are empty, and the whole state of the run is captured, including
that of the simulators if the game has snapshots. If a run stops within a cycle, the resumed run continues from the last
captured state, with the same results as a run that never stopped.
"""

from collections.abc import Generator, Sequence
from contextlib import closing
from functools import partial
from pathlib import Path

from joybridge.config.config import Config
from joybridge.config.errors import DivergedError
from joybridge.config.metrics import Row
from joybridge.contract.memory import keep_memory
from joybridge.policy.policy import Policy
from joybridge.ppo.gae import gae
from joybridge.ppo.schedule import anneal
from joybridge.ppo.threads import use_one_thread
from joybridge.ppo.update import ppo_update
from joybridge.run.checkpoint import has_checkpoint
from joybridge.run.collect import collect
from joybridge.run.folder import check_run
from joybridge.run.recovery import Revive, recovering
from joybridge.run.run_state import RunState, load_state
from joybridge.run.saving import Saver
from joybridge.run.training import Audience, open_training

KEPT = 2**29  # bytes of the largest array that is kept: a minibatch of pictures, as numbers, has hundreds of millions


def train(
    config: Config,
    run: Path,
    addresses: Sequence[str],
    *,
    resume: bool,
    audience: Audience = Audience(),  # noqa: B008
    revive: Revive | None = None,
    record_faults: bool = False,
) -> None:
    """Train `config` in the folder `run` on the simulators at `addresses`, from the beginning or a checkpoint.

    audience: who follows the run; by default, remarks are printed. revive: called when a simulator is lost; returns the
    addresses of simulators that answer. Without it, training ends. record_faults: write what led to a fault of a
    simulator, or to an update that diverged, into the folder faults of the run.

    Raises ConfigError, CheckpointError, StorageError, SimulatorError and DivergedError. The last state
    between two rollouts is saved on any exception.
    """
    use_one_thread()
    keep_memory(KEPT)
    check_run(config, run, resume=resume)
    state = load_state(run) if has_checkpoint(run) else RunState()
    saver = Saver(run, config, state)
    proceed = partial(play_and_learn, config, run, audience, record_faults)
    states = recovering(proceed, state, addresses, revive, config.max_restarts)
    try:
        with closing(states):
            for state in states:
                saver.take(state)
    finally:
        saver.finish()


def play_and_learn(
    config: Config, run: Path, audience: Audience, record_faults: bool, addresses: Sequence[str], state: RunState
) -> Generator[RunState, None, None]:
    """Continue a run from a state, with new sessions. Yield the state after each cycle."""
    with open_training(config, run, addresses, state, audience, record_faults=record_faults) as training:
        while training.timesteps < config.end:
            for _ in range(training.stretches):
                playing = collect(training.groups, training.policies, training.profiler, training.stretch)
                for decision, _ in enumerate(playing, 1):
                    training.count()
                    if decision < training.stretch:  # a row that is due at the end of a rollout waits for its update
                        training.log()
                with training.profiler.measure("learn"):
                    for policy in training.policies:
                        if policy.rollout.full:
                            training.advise(policy)
                            statistics = learn(policy, training.progress, alone=config.cloning == "alone")
                            training.keep(policy, statistics)
                training.renew_opponents()
                training.log()
            if training.timesteps >= config.end:
                training.finish()
            training.end_lesson()
            yield training.capture()


def learn(policy: Policy, progress: float, *, alone: bool = False) -> Row:
    """Improve a policy on its full rollout, after a fraction `progress` of the run, and begin the next rollout.

    alone: demonstrations, if there are any, replace PPO, which then only teaches the critic.

    Return statistics, none if no decision was made in the rollout. Raises DivergedError.
    """
    config, rollout = policy.config, policy.rollout
    statistics: Row = {}
    rollout.close()
    if (decided := rollout.decided()).any():
        advantages = gae(
            policy.rewards(decided),
            rollout.values,
            policy.next_values(),
            rollout.terminated,
            rollout.truncated,
            rollout.final_values,
            decided,
            gamma=config.gamma,
            gae_lambda=config.gae_lambda,
            time_horizon=config.time_horizon,
        )
        normalize = config.normalize_advantage == "rollout"
        times = policy.times(decided)
        batch = rollout.batch(advantages, decided, config.memory.length, times, normalize=normalize)
        batch = batch.to(policy.actor.accelerator)
        coefficients = anneal(progress, config)
        try:
            statistics = ppo_update(
                policy.learner, batch, coefficients, config, policy.shuffles(), policy.cloning(progress, alone=alone)
            )
        except DivergedError as error:
            raise DivergedError(f"after update {policy.updates + 1:,}, {error}") from None
        statistics["value"] = float(rollout.values[decided].mean())
        statistics |= policy.shares(times)
    policy.restart()
    return statistics
