"""`joybridge compare --search`: train trials with settings that Optuna proposes, and end hopeless ones early.

Optuna proposes the trials, prunes them, and keeps them in a journal in the folder. Each trial is a run of its own, as
in a grid. What is proposed follows from the seed and the trials before it. So a search that trains one trial at a time
ends with the same trials if it is killed and repeated.
"""

import argparse
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import optuna
from optuna.storages.journal import JournalFileBackend, JournalStorage
from optuna.trial import TrialState

from joybridge.client.command_line import add_own_game, wanted_simulators
from joybridge.compare.launch import (
    backend,
    check_length,
    check_metric,
    check_variant,
    repetition,
    scored_policy,
    served_specs,
)
from joybridge.compare.page_settings import FOUND
from joybridge.compare.ranges import PRUNE_FROM, Choices, Range, own_settings, read_ranges, settings_of
from joybridge.compare.search_page import Outcome, outcome, ranking, write_page
from joybridge.compare.trials import Search, train
from joybridge.compare.variants import (
    SEARCH,
    Variant,
    check_unchanged,
    kept_spec,
    read_variants,
)
from joybridge.config.config import Config, load_config
from joybridge.config.config_files import dump_yaml, find_config, merge, read_overrides
from joybridge.config.differences import differences, in_words
from joybridge.config.errors import ConfigError
from joybridge.config.files import write_atomically
from joybridge.config.programs import programs_of, with_places
from joybridge.progress import say
from joybridge.run.own_code import check_code_beside
from joybridge.run.run_lock import locked

optuna.logging.set_verbosity(optuna.logging.WARNING)  # it reports each study that is opened

BASE = "search"  # name of the study, and of the configuration that is searched around


def search(options: argparse.Namespace) -> int:
    """Train what is missing of a search, write the page, and return 1 if a trial has failed."""
    path = find_config(options.config)
    add_own_game(options, [options.config])
    base = load_config(path, options.overrides)
    check_code_beside(path, base, trusted=options.trust_run)
    ranges, variant = read_ranges(options.search, path, options.overrides), Variant(BASE, base)
    check(base, ranges, options.metric)
    if (kept := read_variants(options.output)) and BASE not in kept:
        raise ConfigError(f"{options.output} holds a comparison; name another folder with --output")
    check_unchanged(variant, options.output)
    identity = {
        "ranges": {each.key: f"{each}".partition("=")[2] for each in ranges},
        "timesteps": base.end,
        "seed": base.seed,
        "metric": options.metric,
        "behavior": options.behavior,
        **({"prune_from": options.prune_from} if options.prune_from != PRUNE_FROM else {}),
    }
    with locked(options.output, option="--output"):
        study = open_study(options.output, identity)
        complete = sum(trial.state.is_finished() for trial in study.trials) >= options.trials
        spec = (kept_spec(variant, options.output) if complete else None) or served_specs([variant], options)[0]
        made = Search(options, path, base, ranges, study, spec)
        check_game_side(made)
        study.set_user_attr("search", identity)
        if not study.trials and (own := own_settings(ranges, base, path, options.overrides)):
            study.enqueue_trial({each.key: each.read(own[each.key]) for each in ranges})
        try:
            train(made, *backend(options))
        except KeyboardInterrupt:
            say("all trials are kept; repeat the same command to continue")
            raise
        return report(made)


def open_study(folder: Path, identity: Mapping[str, object]) -> optuna.Study:
    """Return the study in a folder, a new one if there is none.

    identity: what must not change in it. Raises ConfigError if it has, or if the journal is damaged.
    """
    journal = folder / SEARCH
    try:
        study = optuna.create_study(
            storage=JournalStorage(JournalFileBackend(str(journal))),
            study_name=BASE,
            load_if_exists=True,
            direction="maximize",
            pruner=optuna.pruners.MedianPruner(),
        )
    except (OSError, ValueError, KeyError) as error:
        raise ConfigError(
            f"{journal} is damaged ({error}); move it away, and repeat the command: runs that are here are not trained "
            "again"
        ) from error
    if changed := list(differences(study.user_attrs.get("search", identity), identity)):
        raise ConfigError(
            f"{folder} holds another search: {in_words(changed)}; repeat the command as it was, or name another folder "
            "with --output"
        )
    return study


def check(base: Config, ranges: Sequence[Range], metric: str) -> None:
    """Raise ConfigError for a search that could have no result."""
    check_length(base)
    if metric == "reward" and any("reward_weights" in each.key for each in ranges):
        raise ConfigError("rewards of other reward_weights cannot be compared; name a metric of the game with --metric")


def check_game_side(made: Search) -> None:
    """Raise ConfigError for a metric that the game does not have, and for ends of ranges that do not fit it."""
    spec, behavior = made.spec, made.options.behavior
    check_metric(Variant(BASE, made.base), spec, made.options.metric, behavior)
    for each in made.ranges:
        values = each.values if isinstance(each, Choices) else (each.write(each.low), each.write(each.high))
        for value in values:
            variant = Variant(f"{each.key}={value}", made.config({each.key: value}))
            check_variant(variant, spec)
            scored_policy(variant, spec, behavior)


def report(made: Search) -> int:
    """Write the page and the best configuration, print the best trials, and return 1 if a trial has failed."""
    options, trials = made.options, made.trials
    if all(trial.state != TrialState.COMPLETE for trial in trials):
        raise ConfigError(f"no trial is complete; the last one: {outcome(trials[-1])}")
    best_trial = made.study.best_trial
    best = settings_of(made.ranges, best_trial.params)
    own = own_settings(made.ranges, made.base, made.path, options.overrides)
    file = options.output / "best.yaml"
    places = with_places(programs_of(options.config, options.typed[0]))
    found = merge(made.config(best).model_dump(), read_overrides(places))
    about = (
        f"{FOUND}{len(trials)} trials of {made.base.end:,} timesteps with seed {made.base.seed}, by {options.metric} "
        f"({best_trial.value:.4g}); searched: {' '.join(map(str, made.ranges))}\n"
    )
    write_atomically(file, (about + dump_yaml(found)).encode())
    commands = next_commands(made, best, file, own)
    result = Outcome(
        made.base.game,
        options.metric,
        made.base.end,
        made.base.seed,
        made.ranges,
        trials,
        best_trial.number,
        settings_of(made.ranges, trials[0].params) == own,
        commands,
        repetition(options),
        made.metric if made.metric != options.metric else "",
        options.figures,
    )
    print(ranking(result), "", *write_page(result, options.output), file, options.output / SEARCH, sep="\n")
    for command in commands:
        say(f"next: {command}")
    return int(any(trial.state == TrialState.FAIL for trial in trials))


def next_commands(made: Search, best: dict[str, str], file: Path, own: dict[str, str]) -> list[str]:
    """Return what to type next: a training with the best settings, and their comparison with the configuration."""
    options = made.options
    overrides, games = options.typed
    named = replace(wanted_simulators(options), games=tuple(games)).arguments()
    train = [
        "joybridge",
        "train",
        options.config,
        *named,
        *overrides,
        *(f"{key}={value}" for key, value in best.items()),
    ]
    if best == own:
        return [shlex.join(train)]
    shared = [each for each in overrides if not each.startswith("seed=")]
    compare = ["joybridge", "compare", options.config, "--also", str(file), *named, "--seeds", "5"]
    return [shlex.join(train), shlex.join([*compare, "--output", f"{options.output}-seeds", *shared])]
