"""The trials of a search: Optuna proposes them, they are trained, judged at rungs, and their results told to Optuna."""

import argparse
import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import optuna
from optuna.trial import FrozenTrial, TrialState
from rich.console import Console

from joybridge.compare.display import SILENCE_SECONDS
from joybridge.compare.grid import POLL_SECONDS, end
from joybridge.compare.job import Job, Process
from joybridge.compare.launch import check_variant, make_job, scored_policy
from joybridge.compare.ranges import Choices, Range, settings_of
from joybridge.compare.scores import Run, score_at, score_run
from joybridge.compare.search_page import outcome, settings_text
from joybridge.compare.variants import Variant, config_path
from joybridge.config.config import Config, dump_config, load_config
from joybridge.config.errors import CheckpointError, ConfigError
from joybridge.config.files import write_atomically
from joybridge.config.metrics import HELD_OUT, metrics_name, read_rows
from joybridge.contract.errors import JoybridgeError
from joybridge.progress import Progress
from joybridge.v1 import bridge_pb2 as pb

FIRST_TRIALS = 3  # trials; if all of them fail, the others would as well
TENTHS = range(1, 10)  # of a run: where a hopeless trial ends


@dataclass(frozen=True)
class Search:
    """What all trials share, and the study that keeps them."""

    options: argparse.Namespace
    path: Path  # of the configuration
    base: Config
    ranges: Sequence[Range]
    study: optuna.Study
    spec: pb.GameSpec
    console: Console = field(default_factory=lambda: Console(highlight=False))

    @property
    def trials(self) -> list[FrozenTrial]:
        """Return the trials that have been proposed, by their numbers."""
        return [trial for trial in self.study.get_trials(deepcopy=False) if trial.state != TrialState.WAITING]

    @property
    def wanted(self) -> bool:
        """Return whether another trial is to be proposed."""
        return len(self.trials) < int(self.options.trials)

    def ended(self, trial: optuna.Trial) -> bool:
        """Return whether it is known what a trial has come to."""
        return self.trials[trial.number].state.is_finished()

    @property
    def rungs(self) -> list[int]:
        """Return the timesteps where trials are compared: ends of rows of metrics before the end of a run."""
        interval, last = self.base.log_interval, self.base.end
        tenths = [tenth for tenth in TENTHS if tenth >= 10 * self.options.prune_from]
        marks = (math.ceil(tenth * last / 10 / interval) * interval for tenth in tenths)
        return [mark for mark in dict.fromkeys(marks) if mark < last]

    def config(self, settings: Mapping[str, str]) -> Config:
        """Return the configuration with other settings, by key. Raises ConfigError."""
        return load_config(self.path, [*self.options.overrides, *(f"{key}={value}" for key, value in settings.items())])

    @property
    def metric(self) -> str:
        """Return the metric of the rungs: that of the training if another is measured only at the end."""
        metric, held_out = str(self.options.metric), self.base.evaluate_during
        at_end = held_out is not None and (held_out.every is None or held_out.every >= self.base.end)
        return metric.removeprefix(HELD_OUT) if at_end else metric


@dataclass(frozen=True)
class Training:
    """The run of a trial."""

    trial: optuna.Trial
    job: Job
    policy: str  # whose metrics count; "" for the only policy of a game

    def __str__(self) -> str:
        """Return how far it is."""
        done = int(self.job.last_row().get("timesteps", 0))
        return f"trial {self.trial.number} at {done:,} of {self.job.timesteps:,} timesteps"

    def run(self, metric: str) -> Run:
        """Return what has been reached by now. Raises ConfigError and CheckpointError if there are no metrics."""
        name = f"metrics-{metrics_name(self.policy)}.csv" if self.policy else "metrics-*.csv"
        for path in sorted(self.job.run.glob(name)):
            return score_run(read_rows(path), str(path), self.job.seed, metric)
        raise CheckpointError(
            f"{self.job.run} has no metrics; delete this folder, and repeat the command to train it again"
        )


def train(made: Search, parallel: int, begin: Callable[[Job], Process]) -> None:
    """Train trials, `parallel` at a time, until so many are there and all have ended.

    Raises ConfigError if the first ones fail. After an interrupt (KeyboardInterrupt), those that run save checkpoints.
    """
    interrupted = [trial for trial in made.trials if not trial.state.is_finished()]
    running: dict[Training, Process] = {}
    try:
        with made.console.status("") as line:
            progress = Progress(lambda text: made.console.print(text, soft_wrap=True, markup=False), SILENCE_SECONDS)
            while interrupted or running or made.wanted:
                while len(running) < parallel and (interrupted or made.wanted):
                    trial = next_trial(made, interrupted, parallel)
                    running |= start_trial(made, trial, begin)
                    check_first(made)
                for training, process in list(running.items()):
                    status = process.poll()
                    if not made.ended(training.trial):
                        judge(made, training, status)
                        if made.ended(training.trial) and status is None:  # it is pruned
                            process.terminate()
                    if status is not None:
                        del running[training]
                check_first(made)
                ended = f"{len(made.trials) - len(running)} of {made.options.trials} trials have ended"
                line.update(ended)
                if not made.console.is_terminal:
                    progress.report("; ".join([ended, *map(str, running)]))
                time.sleep(POLL_SECONDS)
    finally:
        end(list(running.values()))


def next_trial(made: Search, interrupted: list[FrozenTrial], parallel: int) -> optuna.Trial:
    """Return the trial that begins or goes on next, with all its settings. interrupted: those that go on."""
    number = interrupted[0].number if interrupted else len(made.trials)
    seed = int(np.random.SeedSequence((made.base.seed, number)).generate_state(1)[0])
    made.study.sampler = optuna.samplers.TPESampler(seed=seed, constant_liar=parallel > 1)
    trial = optuna.Trial(made.study, interrupted.pop(0)._trial_id) if interrupted else made.study.ask()
    for each in made.ranges:
        if isinstance(each, Choices):
            trial.suggest_categorical(each.key, each.values)
        elif each.whole:
            trial.suggest_int(each.key, int(each.low), int(each.high), log=each.log)
        else:
            trial.suggest_float(each.key, each.low, each.high, log=each.log)
    return trial


def start_trial(made: Search, trial: optuna.Trial, begin: Callable[[Job], Process]) -> dict[Training, Process]:
    """Begin a trial, or go on with it. Nothing is returned if it has ended before, or cannot begin.

    A trial with the settings of an earlier one has its result.
    """
    for earlier in made.trials[: trial.number]:
        if earlier.params == trial.params and earlier.state in (TrialState.COMPLETE, TrialState.PRUNED):
            for timesteps, score in earlier.intermediate_values.items():
                trial.report(score, timesteps)
            finish(made, trial, earlier.state, earlier.value if earlier.state == TrialState.COMPLETE else None)
            return {}
    try:
        variant = Variant(f"trial-{trial.number:03}", made.config(settings_of(made.ranges, trial.params)))
        check_variant(variant, made.spec)
        job = make_job(variant, made.spec, made.base.seed, made.options)
        training = Training(trial, job, scored_policy(variant, made.spec, made.options.behavior))
        write_atomically(config_path(made.options.output, variant.name), dump_config(variant.config).encode())
        if job.finished():
            judge(made, training, 0)
            return {}
        job.prepare()
        return {training: begin(job)}
    except (OSError, JoybridgeError) as error:
        fail(made, trial, f"{error}")
        return {}


def judge(made: Search, training: Training, status: int | None) -> None:
    """Report what a trial has come to by now, and keep whether it has ended: pruned at a rung, complete or failed.

    status: of its process, None while it runs. Only rows of metrics count, not when they are looked at.
    """
    trial = training.trial
    try:
        run = training.run(made.metric if status is None else made.options.metric)
    except JoybridgeError as error:  # nothing can be read yet, or never
        if status is not None:
            fail(made, trial, training.job.failure(status) if status else f"{error}")
        return
    known = made.trials[trial.number].intermediate_values
    for rung in made.rungs:
        score = score_at(run, rung, made.base.end, made.base.log_interval)
        if score is not None and run.points[-1].timesteps >= rung:
            if rung not in known:
                trial.report(score, rung)
            if trial.should_prune():
                finish(made, trial, TrialState.PRUNED)
                return
    if status == 0:
        finish(made, trial, TrialState.COMPLETE, run.score)
    elif status is not None:
        fail(made, trial, training.job.failure(status))


def fail(made: Search, trial: optuna.Trial, reason: str) -> None:
    """Keep that a trial has failed, and why."""
    trial.set_user_attr("reason", reason.removeprefix("error: "))
    finish(made, trial, TrialState.FAIL)


def finish(made: Search, trial: optuna.Trial, state: TrialState, score: float | None = None) -> None:
    """Keep how a trial has ended, and print it."""
    ended = made.study.tell(trial, score, state=state)
    text = f"trial {trial.number}: {outcome(ended)} ({settings_text(made.ranges, ended)})"
    made.console.print(text, soft_wrap=True, markup=False)


def check_first(made: Search) -> None:
    """Raise ConfigError if the first trials have failed, as all others would."""
    first = made.trials[:FIRST_TRIALS]
    if len(first) == FIRST_TRIALS and all(trial.state == TrialState.FAIL for trial in first):
        raise ConfigError(
            f"the first {FIRST_TRIALS} trials have failed, so the search has ended; the last one: "
            f"{first[-1].user_attrs['reason']}; delete {made.options.output}, and repeat the command"
        )
