"""`joybridge compare`: train variants of a configuration with several seeds each, and write a page that compares them.

The folder of a comparison holds everything that a repetition needs: the configurations of the variants and the specs of
their games (`variants.json`), the runs (`runs`), the metrics of finished runs (`runs.csv.xz`), and the page. The
command may be killed at any time. Repeated, it skips finished runs, and ends with the same figures. Finished runs may
be deleted.
"""

import argparse
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import chain, islice
from pathlib import Path

from joybridge.client.command_line import add_own_game, say_next
from joybridge.compare.analysis import Analysis, analyze, least_seeds
from joybridge.compare.grid import is_kept, run_grid
from joybridge.compare.job import Job
from joybridge.compare.launch import (
    backend,
    check_length,
    check_metric,
    different_bodies,
    listed,
    make_job,
    repetition,
    scored_policy,
    seeds,
    served_specs,
    too_short_for_scores,
)
from joybridge.compare.made_with import MadeWith, changed_sources, made_with, note, packages_of
from joybridge.compare.made_with import read as read_made_with
from joybridge.compare.names import ResultName, page_mark
from joybridge.compare.over import Over, over_table, trained_span, write_over_page
from joybridge.compare.page import few_episodes, final_scores, write_page
from joybridge.compare.page_numbers import Setting
from joybridge.compare.page_parts import escaped
from joybridge.compare.page_settings import settings_block
from joybridge.compare.peer_arguments import keep_peer_arguments, peer_arguments
from joybridge.compare.scores import Run, score_run
from joybridge.compare.table import TABLE, Results, read_table
from joybridge.compare.tested import check_test, test_marks, test_runs, test_words
from joybridge.compare.variants import (
    PACKAGES,
    SEARCH,
    Variant,
    beside,
    check_unchanged,
    kept_spec,
    make_variants,
    pairs_to_test,
    read_change,
    read_values,
    read_variants,
)
from joybridge.config.config import load_config
from joybridge.config.config_files import find_config
from joybridge.config.errors import CheckpointError, ConfigError
from joybridge.config.metrics import HELD_OUT, metrics_name, numbers
from joybridge.contract.errors import JoybridgeError
from joybridge.progress import say
from joybridge.run.checkpoint import has_checkpoint
from joybridge.run.lengths import too_few_updates
from joybridge.run.origin import own_origin
from joybridge.run.own_code import check_code_beside
from joybridge.run.run_lock import locked
from joybridge.run.sources import marks
from joybridge.v1 import bridge_pb2 as pb


def compare(options: argparse.Namespace) -> int:
    """Train what is missing, write the page, and return 1 if a run has failed. Raises RunLockedError, and others."""
    if (options.output / SEARCH).exists():
        raise ConfigError(f"{options.output} holds a search; name another folder with --output")
    add_own_game(options, [options.config, *options.also])
    for file in (options.config, *options.also):
        path = find_config(file)
        check_code_beside(path, load_config(path, options.overrides), trusted=options.trust_run)
    grid = [("layout", options.layouts)] if options.layouts else []
    variants = make_variants(
        [options.config, *options.also],
        options.overrides,
        [*grid, *map(read_values, options.set)],
        [*map(read_change, options.change)],
    )
    if options.beside:
        variants += beside(variants, options.beside, options.game)
    for variant in variants:
        check_length(variant.config)
        check_unchanged(variant, options.output)
    arguments = peer_arguments(options)  # before these variants are kept
    specs = find_specs(variants, options)
    for variant, spec in zip(variants, specs, strict=True):
        check_metric(variant, spec, options.metric, options.behavior)
    with locked(options.output, option="--output"):
        keep_peer_arguments(arguments, options.output)
        check_test(variants, specs, options)
        return compare_variants(variants, specs, options)


def compare_variants(variants: Sequence[Variant], specs: Sequence[pb.GameSpec], options: argparse.Namespace) -> int:
    """Train what is missing of variants of games with these specs, write the page, and return 1 if a run has failed."""
    policies = {
        variant.label: scored_policy(variant, spec, options.behavior)
        for variant, spec in zip(variants, specs, strict=True)
    }
    jobs = {
        make_job(variant, spec, seed, options): variant.label
        for seed in seeds(options)
        for variant, spec in zip(variants, specs, strict=True)
    }
    pairs = pairs_to_test(variants, options.pairs)
    sources = marks(options.game, [variant.config for variant in variants])
    for text in remarks(variants, specs, options, sources):
        say(text)
    packages = packages_of(options.game, sorted({PACKAGES[variant.by] for variant in variants if variant.by}))
    try:
        failed = train(list(jobs), options)
    finally:
        note(options.output, [job.run for job in jobs], packages)
    results = read_table(options.output)
    done: dict[Job, Run] = {}
    for job in jobs:
        if job not in failed:
            try:
                done[job] = finished_run(job, policies[jobs[job]], results, options)
            except JoybridgeError as error:
                failed[job] = str(error)
    scored, played = [done], None
    if options.test is not None:
        played = made_with(own_origin(), sources, packages)
        scored, untested = test_runs(done, {job: policies[label] for job, label in jobs.items()}, options, played)
        failed |= untested
    missing = [f"{job.name}: {failed[job].removeprefix('error: ')}" for job in jobs if job in failed]
    for text in missing:
        say(f"missing: {text}")
    if not scored[0]:
        raise ConfigError("there is nothing to compare, because every run is missing")
    files = [find_config(config) for config in (options.config, *options.also)]
    bodies = different_bodies(variants, specs)
    settings = settings_block(variants, files, f"{escaped(bodies[0].upper() + bodies[1:])}." if bodies else "")
    setting = Setting(
        game=variants[0].config.game,
        timesteps=[job.timesteps for job in jobs],
        policies=policies,
        command=repetition(options),
        missing=missing,
        mark=page_mark(options.metric, options.behavior, *test_marks(options)),
        settings=settings,
        test=test_words(options),
        figures=options.figures,
        left_out=[
            *(name for name in read_variants(options.output) if name not in {each.name for each in variants}),
            *left_seeds(jobs, results),
        ],
        made_with=read_made_with(options.output),
        played=played,
    )
    if options.over:
        trained = trained_span(variants, specs, options.over.key)
        over = Over(options.metric, options.over, [by_variant(each, jobs) for each in scored], trained)
        paths = write_over_page(over, setting, options.output)
        print(over_table(over), "", *paths, sep="\n")
        return 1 if missing else 0
    (done,) = scored
    analysis = analyze(options.metric, by_variant(done, jobs), options.score, pairs)
    if options.test is None and not options.metric.startswith(HELD_OUT):
        held_out = held_out_analysis({job: jobs[job] for job in done}, policies, results, options, pairs)
        setting = replace(setting, held_out=held_out)
    paths = write_page(analysis, setting, options.output)
    print(final_scores(analysis), "", *paths, sep="\n")
    if few := few_episodes(analysis):
        say(f"{few} of its training; --test plays whole episodes with every policy")
    if has_checkpoint(best := best_run(analysis, jobs)):
        say_next("evaluate", str(best))
    return 1 if missing else 0


def left_seeds(jobs: Iterable[Job], results: Iterable[ResultName]) -> list[str]:
    """Return the finished runs of the same variants and length that are of no job, as text."""
    compared = {(job.experiment, job.timesteps) for job in jobs}
    others = {each.run for each in results if (each.run.experiment, each.timesteps) in compared}
    left = others - {job.name for job in jobs}
    return [
        f"{run.experiment} with seed {run.seed}" for run in sorted(left, key=lambda run: (run.experiment, run.seed))
    ]


def remarks(
    variants: Sequence[Variant], specs: Sequence[pb.GameSpec], options: argparse.Namespace, sources: dict[str, str]
) -> Iterator[str]:
    """Yield what is said before variants are trained. sources: marks of the files as they are now."""
    if len(variants) > 1:
        yield f"{len(variants)} variants: {listed([variant.label for variant in variants])}"
    pairs = pairs_to_test(variants, options.pairs)
    if pairs and options.seeds < (least := least_seeds(len(pairs))):
        yield (
            f"with {options.seeds} seeds, no two of {len(variants)} variants can differ significantly; "
            f"--seeds {least} is the least number with which they can"
            f"{'' if options.pairs else ', or fewer pairs (--pairs)'}"
        )
    if warning := different_bodies(variants, specs):
        yield warning
    yield from islice(chain.from_iterable(too_few_updates(each.config) for each in variants if not each.by), 1)
    best = {variant.config.best_metric for variant in variants}
    if options.metric == "reward" and len(best) == 1 and (metric := best.pop().removeprefix("-")) != "reward":
        yield f"rewards are compared; the configuration goes by {metric} (best_metric): --metric {metric} compares that"
    if options.test is None and (short := too_short_for_scores(variants, specs, options.metric)):
        yield short
    if changed := changed_sources([*read_made_with(options.output), MadeWith({}, sources)]):
        then = "the test plays them" if options.test is not None else "runs that are still to be trained play them"
        yield (
            f"the files of {', '.join(changed)} have changed since runs of {options.output} were trained; {then} as "
            "they are now, which the page then says"
        )


def by_variant(runs: Mapping[Job, Run], labels: Mapping[Job, str]) -> dict[str, list[Run]]:
    """Return the runs of each variant that has some, in the order of `labels`."""
    found: dict[str, list[Run]] = {label: [] for label in labels.values()}
    for job, run in runs.items():
        found[labels[job]].append(run)
    return {label: each for label, each in found.items() if each}


def find_specs(variants: Sequence[Variant], options: argparse.Namespace) -> list[pb.GameSpec]:
    """Return the spec of each variant's game. Raises ConfigError for one that does not fit or has changed.

    No simulator is needed for a comparison whose runs are all finished.
    """
    kept = [kept_spec(variant, options.output) for variant in variants]
    known = [(variant, spec) for variant, spec in zip(variants, kept, strict=True) if spec]
    jobs = [make_job(*one, seed, options) for one in known for seed in seeds(options)]
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


def held_out_analysis(
    jobs: Mapping[Job, str],
    policies: Mapping[str, str],
    results: Results,
    options: argparse.Namespace,
    tested: Sequence[tuple[str, str]] | None = None,
) -> Analysis | None:
    """Return the statistics of what `evaluate_during` has measured beside the metric; None if a run has none of it.

    jobs: the finished ones, with the labels of their variants. policies: whose metrics count, by label. tested: as of
    `analyze`.
    """
    given = argparse.Namespace(**{**vars(options), "metric": f"{HELD_OUT}{options.metric}"})
    try:
        runs = {job: finished_run(job, policies[label], results, given) for job, label in jobs.items()}
    except (ConfigError, CheckpointError):  # no such column, or one with a number that is not finite
        return None
    return analyze(given.metric, by_variant(runs, jobs), tested=tested)


def best_run(analysis: Analysis, jobs: Mapping[Job, str]) -> Path:
    """Return the folder of the run with the highest score of the variant with the highest interquartile mean."""
    result = max(analysis.results, key=lambda result: result.iqm.value)
    seed = max(result.runs, key=lambda run: run.score).seed
    return next(job.run for job, label in jobs.items() if (label, job.seed) == (result.label, seed))
