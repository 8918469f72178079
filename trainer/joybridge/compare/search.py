"""`joybridge compare --search`: train trials with settings that Optuna proposes, and end hopeless ones early.

Each trial is a run of its own, as in a grid. A trial is proposed, and judged at its rungs, from the results of a fixed
set of earlier trials, whenever it happens to run. So a search that is killed and repeated ends with the same trials.
"""

import argparse
import shlex
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from joybridge.client.command_line import say, wanted_simulators
from joybridge.compare.grid import POLL_SECONDS, end
from joybridge.compare.job import Job, Process
from joybridge.compare.launch import backend, check_variant, make_job, repetition, scored_policy, served_specs
from joybridge.compare.proposals import hopeless, importances, propose
from joybridge.compare.ranges import Choices, Range, own_settings, read_ranges
from joybridge.compare.scores import Run, score_run
from joybridge.compare.search_display import Display
from joybridge.compare.search_page import ENOUGH, Outcome, ranking, write_page
from joybridge.compare.trials import (
    Trial,
    best_trial,
    name_of,
    read_record,
    rungs,
    score_so_far,
    until,
    write_record,
)
from joybridge.compare.variants import Variant, check_unchanged, config_path, kept_spec, read_variants
from joybridge.config.config import Config, dump_config, load_config
from joybridge.config.config_files import find_config
from joybridge.config.errors import CheckpointError, ConfigError
from joybridge.config.files import write_atomically
from joybridge.config.metrics import column_name, is_trainers, metrics_name, read_rows
from joybridge.contract.errors import JoybridgeError
from joybridge.run.run_lock import locked
from joybridge.v1 import bridge_pb2 as pb

BASE = "search"  # name of the configuration that is searched around
FIRST = 3  # trials; if all of them fail, the others would as well


@dataclass
class Search:
    """What all trials share, and the trials so far."""

    options: argparse.Namespace
    path: Path  # of the configuration
    base: Config
    ranges: list[Range]
    spec: pb.GameSpec = field(default_factory=pb.GameSpec)
    trials: list[Trial] = field(default_factory=list)

    @property
    def identity(self) -> dict[str, object]:
        """Return what must not change in a folder."""
        return {
            "ranges": {each.key: f"{each}".partition("=")[2] for each in self.ranges},
            "timesteps": self.base.end, "seed": self.base.seed,
            "metric": self.options.metric, "behavior": self.options.behavior,
        }  # fmt: skip

    @property
    def record(self) -> Path:
        """Return the file that keeps the trials."""
        return Path(self.options.output, "search.json")

    def keep(self, number: int, trial: Trial) -> None:
        """Change a trial, or add the next one, and write the record. Raises StorageError."""
        self.trials[number:number + 1] = [trial]  # fmt: skip
        write_record(self.record, self.identity, self.trials)

    def config(self, settings: Mapping[str, str]) -> Config:
        """Return the configuration with other settings, by key. Raises ConfigError."""
        return load_config(self.path, [*self.options.overrides, *(f"{key}={settings[key]}" for key in settings)])


@dataclass(frozen=True)
class Training:
    """The run of a trial."""

    number: int
    job: Job
    known: int  # so many trials, the first ones, it is compared with
    policy: str  # whose metrics count; "" for the only policy of a game
    interval: int  # timesteps between two rows of metrics

    def run(self, metric: str) -> Run:
        """Return what has been reached by now. Raises ConfigError and CheckpointError if there are no metrics."""
        paths = sorted(self.job.run.glob("metrics-*.csv"))
        wanted = f"metrics-{metrics_name(self.policy)}" if self.policy else None
        for path in paths:
            if wanted in (None, path.stem):
                return score_run(read_rows(path), str(path), self.job.seed, metric)
        raise CheckpointError(
            f"{self.job.run} has no metrics; delete this folder, and repeat the command to train it again"
        )


def search(options: argparse.Namespace) -> int:
    """Train what is missing of a search, write the page, and return 1 if a trial has failed."""
    path = find_config(options.config)
    base = load_config(path, options.overrides)
    made = Search(options, path, base, read_ranges(options.search, path, options.overrides))
    check(made)
    variant = Variant(BASE, base)
    if (kept := read_variants(options.output)) and BASE not in kept:
        raise ConfigError(f"{options.output} holds a comparison; name another folder with --output")
    check_unchanged(variant, options.output)
    made.trials = read_record(made.record, made.identity, made.ranges)
    ended = sum(trial.state != "running" for trial in made.trials)
    complete = ended == len(made.trials) and ended >= options.trials
    made.spec = (kept_spec(variant, options.output) if complete else None) or served_specs([variant], options)[0]
    check_game_side(made)
    if not complete:
        with locked(options.output, option="--output"):
            made.trials = read_record(made.record, made.identity, made.ranges)  # nobody else changes it from now on
            try:
                train(made, *backend(options))
            except KeyboardInterrupt:
                say("all trials are kept; repeat the same command to continue")
                raise
    if len(made.trials) < options.trials:
        say(f"{len(made.trials)} trials have tried all combinations, so the search has ended")
    if best_trial(made.trials) is None:
        raise ConfigError(f"no trial is complete; the last one: {made.trials[-1].reason or made.trials[-1].state}")
    return report(made)


def check(made: Search) -> None:
    """Raise ConfigError for a search that could have no result."""
    base, metric = made.base, made.options.metric
    if base.log_interval > base.end:
        raise ConfigError(
            f"log_interval is {base.log_interval:,}, longer than the trials of {base.end:,} timesteps, so they have no "
            "metrics; make it a tenth of them or less"
        )
    if metric == "reward" and any("reward_weights" in each.key for each in made.ranges):
        raise ConfigError("rewards of other reward_weights cannot be compared; name a metric of the game with --metric")


def check_game_side(made: Search) -> None:
    """Raise ConfigError for a metric that the game does not have, and for ends of ranges that do not fit it."""
    metric, behaviors = made.options.metric, made.spec.behaviors
    names = dict.fromkeys(each.name for behavior in behaviors for each in behavior.metrics)
    known = ["reward", "length", *map(column_name, names)]
    if metric not in known and not is_trainers(metric):
        raise ConfigError(f"--metric got {metric!r}; {made.spec.name} has {', '.join(known)}")
    for each in made.ranges:
        values = each.values if isinstance(each, Choices) else (each.write(each.low), each.write(each.high))
        for value in values:
            variant = Variant(f"{each.key}={value}", made.config({each.key: value}))
            check_variant(variant, made.spec)
            scored_policy(variant, made.spec, made.options.behavior)


def train(made: Search, parallel: int, begin: Callable[[Job], Process]) -> None:
    """Train trials, `parallel` at a time, until so many are there and all have ended.

    Raises ConfigError if the first ones fail. After an interrupt (KeyboardInterrupt), those that run save checkpoints.
    """
    waiting = [number for number, trial in enumerate(made.trials) if trial.state == "running"]
    running: dict[Training, Process] = {}
    display = Display(made.ranges, made.options.trials, made.base.end)
    try:
        with display.live:
            while True:
                while len(running) < parallel and (number := next_trial(made, waiting, parallel)) is not None:
                    running |= start_trial(made, number, parallel, begin)
                    if made.trials[number].state != "running":
                        display.end(number, made.trials[number])
                    check_first(made.trials)
                if not running:
                    return
                for training, process in list(running.items()):
                    status, number = process.poll(), training.number
                    if made.trials[number].state == "running":
                        judge(made, training, status)
                        if made.trials[number].state == "pruned" and status is None:
                            process.terminate()
                        if made.trials[number].state != "running":
                            display.end(number, made.trials[number])
                    if status is not None:
                        del running[training]
                display.update(made.trials, {training.number: training.job for training in running})
                time.sleep(POLL_SECONDS)
                check_first(made.trials)
    finally:
        end(list(running.values()))


def next_trial(made: Search, waiting: list[int], parallel: int) -> int | None:
    """Return the number of the trial that begins or goes on next; None if there is none now.

    waiting: those that were interrupted. A new one is proposed and kept first.
    """
    if waiting:
        return waiting.pop(0)
    number = len(made.trials)
    known = known_to(number, parallel)
    if number >= made.options.trials or any(trial.state == "running" for trial in made.trials[:known]):
        return None
    own = own_settings(made.ranges, made.base, made.path, made.options.overrides) if number == 0 else {}
    unknown = [Trial(settings=trial.settings) for trial in made.trials[known:]]
    settings = own or propose(made.ranges, [*made.trials[:known], *unknown], made.base.seed)
    if settings is None:
        return None
    made.keep(number, Trial(settings=settings))
    return number


def known_to(number: int, parallel: int) -> int:
    """Return how many trials, the first ones, have ended before a trial begins.

    It is proposed and judged from their results alone, so these do not depend on which trial was faster.
    """
    return max(0, number - 2 * (parallel - 1))


def start_trial(made: Search, number: int, parallel: int, begin: Callable[[Job], Process]) -> dict[Training, Process]:
    """Begin a trial, or go on with it. Nothing is returned if it has ended before, or cannot begin."""
    settings, options = made.trials[number].settings, made.options
    try:
        variant = Variant(name_of(number), made.config(settings))
        check_variant(variant, made.spec)
        job = make_job(variant, made.spec, made.base.seed, options)
        policy = scored_policy(variant, made.spec, options.behavior)
        training = Training(number, job, known_to(number, parallel), policy, variant.config.log_interval)
        write_atomically(config_path(options.output, variant.name), dump_config(variant.config).encode())
        finished = job.finished()
        if finished or job.exact:
            judge(made, training, 0 if finished else None)
        else:  # it begins anew
            made.trials[number] = Trial(settings=settings)
        if made.trials[number].state == "running":
            job.prepare()
            return {training: begin(job)}
    except (OSError, JoybridgeError) as error:
        fail(made, number, f"{error}")
    return {}


def judge(made: Search, training: Training, status: int | None) -> None:
    """Keep what a trial has come to by now: pruned at a rung, complete, failed, or still running.

    status: of its process, None while it runs. Only rows of metrics count, not when they are looked at.
    """
    number, trial = training.number, made.trials[training.number]
    try:
        run = training.run(made.options.metric)
    except JoybridgeError as error:  # nothing can be read yet, or never
        if status is not None:
            fail(made, number, training.job.failure(status) if status else f"{error}")
        return
    for rung in rungs(made.base.end, training.interval):
        part = until(run, rung, training.interval)
        if part and rung not in trial.rungs and run.points[-1].timesteps >= rung:
            score = score_so_far(part, made.base.end, training.interval)
            trial = trial.model_copy(update={"timesteps": rung, "rungs": {**trial.rungs, rung: score}})
            if hopeless(made.ranges, made.trials[: training.known], trial.settings, trial.rungs):
                made.keep(number, trial.model_copy(update={"state": "pruned"}))
                return
    whole = until(run, made.base.end, training.interval)
    if status == 0 and whole:
        update = {"state": "complete", "timesteps": made.base.end, "score": whole.score}
        made.keep(number, trial.model_copy(update=update))
    elif status is not None:
        fail(made, number, training.job.failure(status))
    elif trial is not made.trials[number]:
        made.keep(number, trial)


def fail(made: Search, number: int, reason: str) -> None:
    """Keep that a trial has failed, and why."""
    update = {"state": "failed", "reason": reason.removeprefix("error: ")}
    made.keep(number, made.trials[number].model_copy(update=update))


def check_first(trials: Sequence[Trial]) -> None:
    """Raise ConfigError if the first trials have failed, as all others would."""
    if len(trials) >= FIRST and all(trial.state == "failed" for trial in trials[:FIRST]):
        raise ConfigError(
            f"the first {FIRST} trials have failed, so the search has ended; the last one: {trials[FIRST - 1].reason}; "
            "repeat the command to try them again"
        )


def report(made: Search) -> int:
    """Write the page and the best configuration, print the best trials, and return 1 if a trial has failed."""
    options, complete = made.options, [trial for trial in made.trials if trial.state == "complete"]
    own = own_settings(made.ranges, made.base, made.path, options.overrides)
    best = best_trial(made.trials)
    assert best is not None
    file = options.output / "best.yaml"
    write_atomically(file, dump_config(made.config(made.trials[best].settings)).encode())
    commands = next_commands(made, made.trials[best], file, own)
    result = Outcome(
        made.base.game, options.metric, made.base.end, made.base.seed, made.ranges, made.trials,
        made.trials[0].settings == own, importances(made.ranges, made.trials) if len(complete) >= ENOUGH else {},
        commands, repetition(options),
    )  # fmt: skip
    print(ranking(result), "", *write_page(result, options.output), file, made.record, sep="\n")
    for command in commands:
        say(f"next: {command}")
    return int(any(trial.state == "failed" for trial in made.trials))


def next_commands(made: Search, best: Trial, file: Path, own: dict[str, str]) -> list[str]:
    """Return what to type next: a training with the best settings, and their comparison with the configuration."""
    options, named = made.options, wanted_simulators(made.options).arguments()
    train = ["joybridge", "train", options.config, *named, *options.overrides, *best.overrides()]
    if best.settings == own:
        return [shlex.join(train)]
    overrides = [each for each in options.overrides if not each.startswith("seed=")]
    compare = ["joybridge", "compare", options.config, "--also", str(file), *named, "--seeds", "5"]
    compare += ["--output", f"{options.output}-seeds", *overrides]
    return [shlex.join(train), shlex.join(compare)]
