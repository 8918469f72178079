"""`joybridge compare`: train variants of a configuration with several seeds each, and write a page that compares them.

The folder of a comparison holds everything that a repetition needs: the configurations of the variants and the specs of
their games (`variants.json`), the runs (`runs`), the metrics of finished runs (`runs.csv.xz`), and the page. The
command may be killed at any time. Repeated, it skips finished runs, and ends with the same figures. Finished runs may
be deleted.
"""

import argparse
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

from joybridge.client.argument_types import at_least
from joybridge.client.command_line import (
    add_own_game,
    add_simulator_options,
    check_simulator_options,
    run_command,
    say_next,
)
from joybridge.compare.analysis import Analysis, analyze, least_seeds
from joybridge.compare.grid import is_kept, run_grid
from joybridge.compare.job import Job
from joybridge.compare.launch import (
    backend,
    check_length,
    check_metric,
    make_job,
    repetition,
    scored_policy,
    served_specs,
)
from joybridge.compare.names import ResultName, page_mark
from joybridge.compare.page import final_scores, write_page
from joybridge.compare.page_numbers import Setting
from joybridge.compare.ranges import is_fixed
from joybridge.compare.scores import Run, score_run
from joybridge.compare.suite import SUITES, compare_suite
from joybridge.compare.table import TABLE, Results, read_table
from joybridge.compare.variants import (
    SEARCH,
    TRAINERS,
    Variant,
    beside,
    check_unchanged,
    kept_spec,
    make_variants,
    read_change,
    read_values,
)
from joybridge.config.errors import ConfigError
from joybridge.config.metrics import metrics_name, numbers
from joybridge.config.overrides import add_overrides, parse_overrides
from joybridge.contract.errors import JoybridgeError
from joybridge.progress import say
from joybridge.run.checkpoint import has_checkpoint
from joybridge.run.run_lock import locked
from joybridge.v1 import bridge_pb2 as pb

SEEDS = 5
TRIALS = 30
OVERRIDE = re.compile(r"[a-z_.]+=")  # not a mixture of layouts, as in "hybrid, angle=bucket-5"


def main(arguments: Sequence[str] | None = None, prog: str = "python -m joybridge.compare") -> int:
    """Run the command line, the command first, and return its exit status."""
    options = parse(arguments, prog)
    if options.suite:
        return run_command(lambda given: compare_suite(given, compare), options)
    return run_command(search if options.search else compare, options)


def parse(arguments: Sequence[str] | None, prog: str) -> argparse.Namespace:
    """Return the options."""
    parser = argparse.ArgumentParser(prog=prog)
    commands = parser.add_subparsers(dest="command", required=True)
    compares = commands.add_parser(
        "compare", help="train variants of a configuration with several seeds, and write a page that compares them"
    )
    compares.add_argument("config", nargs="?", help="a YAML file, or the name of an installed one, as in archer/hybrid")
    compares.add_argument(
        "--suite", choices=SUITES, help="compare on all tasks of a suite instead of one configuration, on one page"
    )
    compares.add_argument("--tasks", nargs="+", default=[], metavar="TASK", help="of the suite; default: all")
    compares.add_argument("--layouts", nargs="+", default=[], metavar="LAYOUT", help="e.g. hybrid bucket-5 multiagent")
    compares.add_argument(
        "--set",
        nargs="+",
        action="extend",
        default=[],
        metavar="KEY=VALUE,VALUE,…",
        help="any other key that varies, as in policy.learning_rate=1e-3,3e-3; all combinations are trained",
    )
    compares.add_argument(
        "--change",
        nargs="+",
        action="extend",
        default=[],
        metavar="KEY=VALUE",
        help="one change at a time: each is compared with the configuration as it is; quoted, several keys are one "
        "change, as in 'policy.gamma=0.9 policy.epochs=8'",
    )
    compares.add_argument(
        "--also",
        action="append",
        default=[],
        metavar="CONFIG",
        help="another configuration of the same game that is compared; may be repeated",
    )
    compares.add_argument(
        "--beside",
        choices=TRAINERS,
        help="train each variant also with PPO of Stable-Baselines3, on the same environment of Gymnasium",
    )
    compares.add_argument("--ppo", default="{}", metavar="JSON", help="further arguments of PPO there")
    compares.add_argument(
        "--search",
        nargs="+",
        action="extend",
        default=[],
        metavar="KEY=RANGE",
        help="search for the best settings instead, within ranges and choices: "
        "policy.learning_rate=1e-5..1e-3:log policy.epochs=3..10 layout=hybrid,bucket-11",
    )
    compares.add_argument("--trials", type=at_least(1), metavar="N", help=f"trainings of a search; default {TRIALS}")
    compares.add_argument("--seeds", type=at_least(1), metavar="N", help=f"runs of each variant; default {SEEDS}")
    compares.add_argument("--output", type=Path, required=True, metavar="FOLDER", help="for the runs and the page")
    compares.add_argument("--metric", default="reward", help="the column that is compared; default %(default)s")
    compares.add_argument("--behavior", metavar="NAME", help="whose metrics are compared; default: the game's first")
    compares.add_argument(
        "--score", type=float, help="that runs are timed to; default: the lowest interquartile mean of a variant"
    )
    compares.add_argument(
        "--jobs",
        type=at_least(1),
        help="runs at the same time, each on two cores; default: 1, on a cluster as many as fit",
    )
    compares.add_argument("--backend", choices=("local", "ray"), default="local", help="where to train")
    compares.add_argument(
        "--cluster", metavar="HOST:PORT", help="of a running Ray cluster; default: start a local one for this command"
    )
    add_simulator_options(compares)
    add_overrides(compares, "keys that all variants share, e.g. total_timesteps=100000")
    options = parse_overrides(parser, arguments)
    for name in ("layouts", "tasks"):  # overrides may stand behind them
        words = getattr(options, name)
        options.overrides += [word for word in words if OVERRIDE.match(word)]
        setattr(options, name, [word for word in words if not OVERRIDE.match(word)])
    check_simulator_options(parser, options)
    if options.suite and options.config and OVERRIDE.match(options.config):
        options.overrides, options.config = [options.config, *options.overrides], None
    if bool(options.suite) == bool(options.config):
        parser.error("name a configuration, or a suite with --suite")
    if options.suite and (options.search or options.also or options.beside):
        parser.error("--search, --also and --beside are for one configuration, not for a suite")
    if options.tasks and not options.suite:
        parser.error("--tasks are those of a suite; name it with --suite")
    fixed = list(filter(is_fixed, options.search))  # they may stand behind what is searched
    if fixed and fixed == options.search:
        parser.error(f"--search {' '.join(fixed)}: nothing varies; write KEY=LOW..HIGH or KEY=VALUE,VALUE")
    options.search = [word for word in options.search if word not in fixed]
    options.overrides += fixed
    if options.search:
        for name in ("layouts", "set", "change", "also", "seeds", "score"):
            if getattr(options, name) not in ([], None):
                parser.error(f"--{name} is not for a search; write what varies as --search KEY=VALUE,VALUE")
    elif options.trials:
        parser.error("--trials is for a search; say what is searched with --search, or use --seeds")
    options.trials, options.seeds = options.trials or TRIALS, options.seeds or SEEDS
    return options


def search(options: argparse.Namespace) -> int:
    """Search for the best settings; Optuna is imported only now. Raises ConfigError if it is not there."""
    try:
        from joybridge.compare.search import search as run
    except ModuleNotFoundError as error:
        if (error.name or "").startswith("joybridge"):
            raise
        raise ConfigError(
            f"--search needs the module {error.name}; install it with `pip install 'joybridge[search]'`"
        ) from error
    return run(options)


def compare(options: argparse.Namespace) -> int:
    """Train what is missing, write the page, and return 1 if a run has failed. Raises RunLockedError, and others."""
    if (options.output / SEARCH).exists():
        raise ConfigError(f"{options.output} holds a search; name another folder with --output")
    add_own_game(options, [options.config, *options.also])
    grid = [("layout", options.layouts)] if options.layouts else []
    variants = make_variants(
        [options.config, *options.also],
        options.overrides,
        [*grid, *map(read_values, options.set)],
        [*map(read_change, options.change)],
    )
    if options.beside:
        variants += beside(variants, options.beside)
    for variant in variants:
        check_length(variant.config)
        check_unchanged(variant, options.output)
    specs = find_specs(variants, options)
    for variant, spec in zip(variants, specs, strict=True):
        check_metric(variant, spec, options.metric, options.behavior)
    with locked(options.output, option="--output"):
        return compare_variants(variants, specs, options)


def compare_variants(variants: Sequence[Variant], specs: Sequence[pb.GameSpec], options: argparse.Namespace) -> int:
    """Train what is missing of variants of games with these specs, write the page, and return 1 if a run has failed."""
    policies = {
        variant.label: scored_policy(variant, spec, options.behavior)
        for variant, spec in zip(variants, specs, strict=True)
    }
    jobs = {
        make_job(variant, spec, seed, options): variant.label
        for seed in range(options.seeds)
        for variant, spec in zip(variants, specs, strict=True)
    }
    if options.seeds < (least := least_seeds(len(variants))):
        say(
            f"with {options.seeds} seeds, no two of {len(variants)} variants can differ significantly; "
            f"--seeds {least} is the least number with which they can"
        )
    failed = train(list(jobs), options)
    results = read_table(options.output)
    runs: dict[str, list[Run]] = {}
    missing = []
    for job, label in jobs.items():
        try:
            if job in failed:
                raise ConfigError(failed[job].removeprefix("error: "))
            run = finished_run(job, policies[label], results, options)
            runs.setdefault(label, []).append(run)
        except JoybridgeError as error:
            missing.append(f"{job.name}: {error}")
            say(f"missing: {missing[-1]}")
    if not runs:
        raise ConfigError("there is nothing to compare, because every run is missing")
    analysis = analyze(options.metric, {label: runs[label] for label in policies if label in runs}, options.score)
    setting = Setting(
        variants[0].config.game,
        [job.timesteps for job in jobs],
        policies,
        repetition(options),
        missing,
        page_mark(options.metric, options.behavior),
    )
    paths = write_page(analysis, setting, options.output)
    print(final_scores(analysis), "", *paths, sep="\n")
    if has_checkpoint(best := best_run(analysis, jobs)):
        say_next("evaluate", str(best))
    return 1 if missing else 0


def find_specs(variants: Sequence[Variant], options: argparse.Namespace) -> list[pb.GameSpec]:
    """Return the spec of each variant's game. Raises ConfigError for one that does not fit or has changed.

    No simulator is needed for a comparison whose runs are all finished.
    """
    kept = [kept_spec(variant, options.output) for variant in variants]
    known = [(variant, spec) for variant, spec in zip(variants, kept, strict=True) if spec]
    jobs = [make_job(*one, seed, options) for one in known for seed in range(options.seeds)]
    results = read_table(options.output)
    if len(known) == len(variants) and all(is_deleted(job, results) or job.finished() for job in jobs):
        return [spec for _, spec in known]
    return served_specs(variants, options)


def train(jobs: Sequence[Job], options: argparse.Namespace) -> dict[Job, str]:
    """Train what is not finished. Return the failed runs with the reasons."""
    results = read_table(options.output)
    jobs = [job for job in jobs if not is_deleted(job, results)]
    if options.backend == "ray" and all(job.finished() for job in jobs):
        options.backend = "local"  # a cluster would have nothing to do
    parallel, begin = backend(options)
    try:
        return run_grid(jobs, parallel, options.output, begin)
    except KeyboardInterrupt:
        say("finished runs are kept; repeat the same command to continue")
        raise


def is_deleted(job: Job, results: Results) -> bool:
    """Return whether a finished run was deleted, or is on another machine; its metrics are all that the page needs."""
    return not job.run.exists() and is_kept(job, results)


def finished_run(job: Job, policy: str, results: Results, options: argparse.Namespace) -> Run:
    """Return what a finished run has reached. Raises ConfigError and CheckpointError."""
    name = ResultName(job.name, job.timesteps, metrics_name(policy))
    if name not in results:
        raise ConfigError(f"{job.run} has no metrics; delete this folder, and repeat the command to train it again")
    return score_run(numbers(results[name]), f"{name} in {options.output / TABLE}", job.seed, options.metric)


def best_run(analysis: Analysis, jobs: Mapping[Job, str]) -> Path:
    """Return the folder of the run with the highest score of the variant with the highest interquartile mean."""
    result = max(analysis.results, key=lambda result: result.iqm.value)
    seed = max(result.runs, key=lambda run: run.score).seed
    return next(job.run for job, label in jobs.items() if (label, job.seed) == (result.label, seed))
