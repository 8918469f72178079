"""`joybridge compare`: train variants of a configuration with several seeds each, and write a page that compares them.

The folder of a comparison holds everything that a repetition needs: the configurations of the variants and the specs of
their games (`configs`), the runs (`runs`), the metrics of finished runs (`metrics`), and the page. The command may be
killed at any time. Repeated, it skips finished runs, and ends with the same figures. Finished runs may be deleted.
"""

import argparse
import re
import shlex
from collections.abc import Mapping, Sequence
from pathlib import Path

from joybridge.contract.errors import JoybridgeError
from joybridge.experiments.analysis import Analysis, analyze
from joybridge.experiments.cluster import Cluster
from joybridge.experiments.grid import kept_results, run_grid
from joybridge.experiments.job import Job, start
from joybridge.experiments.names import ResultName
from joybridge.experiments.page import Setting, final_scores, write_page
from joybridge.experiments.scores import Run, read_run
from joybridge.experiments.variants import (
    Variant,
    check_game,
    check_unchanged,
    keep,
    kept_spec,
    make_variants,
    read_values,
)
from joybridge.trainer.command_line import (
    add_simulator_options,
    at_least,
    check_simulator_options,
    run_command,
    say,
    say_next,
    wanted_simulators,
)
from joybridge.trainer.config_fit import check_fit, fitting_spec
from joybridge.trainer.errors import ConfigError
from joybridge.trainer.layouts import list_roles
from joybridge.trainer.metrics import metrics_name
from joybridge.trainer.overrides import add_overrides, parse_overrides
from joybridge.trainer.simulators import open_simulators
from joybridge.v1 import bridge_pb2 as pb

OVERRIDE = re.compile(r"[a-z_.]+=")  # not a mixture of layouts, as in "hybrid, angle=bucket-5"


def main(arguments: Sequence[str] | None = None, prog: str = "python -m joybridge.experiments") -> int:
    """Run the command line, the command first, and return its exit status."""
    return run_command(compare, parse(arguments, prog))


def parse(arguments: Sequence[str] | None, prog: str) -> argparse.Namespace:
    """Return the options."""
    parser = argparse.ArgumentParser(prog=prog)
    commands = parser.add_subparsers(dest="command", required=True)
    compares = commands.add_parser(
        "compare", help="train variants of a configuration with several seeds, and write a page that compares them"
    )
    compares.add_argument("config", help="a YAML file, or the name of an installed one, as in archer/hybrid")
    compares.add_argument("--layouts", nargs="+", default=[], metavar="LAYOUT", help="e.g. hybrid bucket-5 multiagent")
    compares.add_argument(
        "--set", nargs="+", action="extend", default=[], metavar="KEY=VALUE,VALUE,…",
        help="any other key that varies, as in policy.learning_rate=1e-3,3e-3; all combinations are trained",
    )  # fmt: skip
    compares.add_argument(
        "--seeds", type=at_least(1), default=5, metavar="N", help="runs of each variant; default %(default)s"
    )
    compares.add_argument("--output", type=Path, required=True, metavar="FOLDER", help="for the runs and the page")
    compares.add_argument("--metric", default="reward", help="the column that is compared; default %(default)s")
    compares.add_argument("--behavior", metavar="NAME", help="whose metrics are compared; default: the game's first")
    compares.add_argument(
        "--score", type=float, help="that runs are timed to; default: the lowest interquartile mean of a variant"
    )
    compares.add_argument(
        "--jobs", type=at_least(1),
        help="runs at the same time, each on two cores; default: 1, on a cluster as many as fit",
    )  # fmt: skip
    compares.add_argument("--backend", choices=("local", "ray"), default="local", help="where to train")
    compares.add_argument(
        "--cluster", metavar="HOST:PORT", help="of a running Ray cluster; default: start a local one for this command"
    )
    add_simulator_options(compares)
    add_overrides(compares, "keys that all variants share, e.g. total_timesteps=100000")
    options = parse_overrides(parser, arguments)
    overrides = [word for word in options.layouts if OVERRIDE.match(word)]  # they may stand behind the layouts
    options.layouts = [word for word in options.layouts if word not in overrides]
    options.overrides += overrides
    check_simulator_options(parser, options)
    return options


def compare(options: argparse.Namespace) -> int:
    """Train what is missing, write the page, and return 1 if a run has failed."""
    grid = [("layout", options.layouts)] if options.layouts else []
    variants = make_variants(options.config, options.overrides, [*grid, *map(read_values, options.set)])
    for variant in variants:
        check_unchanged(variant, options.output)
    specs = find_specs(variants, options)
    policies = {
        variant.label: scored_policy(variant, spec, options.behavior)
        for variant, spec in zip(variants, specs, strict=True)
    }
    jobs = {
        make_job(variant, spec, seed, options): variant.label
        for seed in range(options.seeds)
        for variant, spec in zip(variants, specs, strict=True)
    }
    failed = train(list(jobs), options)
    runs: dict[str, list[Run]] = {}
    missing = []
    for job, label in jobs.items():
        try:
            if job in failed:
                raise ConfigError(failed[job].removeprefix("error: "))
            run = finished_run(job, policies[label], options)
            runs.setdefault(label, []).append(run)
        except JoybridgeError as error:
            missing.append(f"{job.name}: {error}")
            say(f"missing: {missing[-1]}")
    if not runs:
        raise ConfigError("there is nothing to compare, because every run is missing")
    analysis = analyze(options.metric, {label: runs[label] for label in policies if label in runs}, options.score)
    setting = Setting(variants[0].config.game, [job.timesteps for job in jobs], policies, repetition(options), missing)
    paths = write_page(analysis, setting, options.output)
    print(final_scores(analysis.results), "", *paths, sep="\n")
    if (best := best_run(analysis, jobs)).exists():
        say_next("evaluate", str(best))
    return 1 if missing else 0


def find_specs(variants: Sequence[Variant], options: argparse.Namespace) -> list[pb.GameSpec]:
    """Return the spec of each variant's game. Raises ConfigError for one that does not fit or has changed.

    No simulator is needed for a comparison whose runs are all finished.
    """
    kept = [kept_spec(variant, options.output) for variant in variants]
    known = [(variant, spec) for variant, spec in zip(variants, kept, strict=True) if spec]
    jobs = [make_job(*one, seed, options) for one in known for seed in range(options.seeds)]
    if len(known) == len(variants) and all(is_finished(job, options) for job in jobs):
        return [spec for _, spec in known]
    with open_simulators(wanted_simulators(options), options.wait, say) as connect:
        address = connect()[0]
        specs = [fitting_spec(address, variant.config) for variant in variants]
    for variant, spec in zip(variants, specs, strict=True):
        try:
            check_fit(variant.config, spec)
        except ConfigError as error:
            raise ConfigError(f"{variant.label}: {error}") from error
        check_game(variant, spec, options.output)
    for variant, spec in zip(variants, specs, strict=True):
        keep(variant, spec, options.output)
    return specs


def make_job(variant: Variant, spec: pb.GameSpec, seed: int, options: argparse.Namespace) -> Job:
    """Return a run of a variant.

    Without snapshots, a run that goes on after a loss has other figures; such a run ends, and is repeated as a whole.
    """
    exact = bool(spec.snapshot_bytes_per_arena)
    return Job(
        variant.name, seed, variant.config.end, options.output / "configs", options.output / "runs",
        overrides=() if exact else ("restarts=0",), arguments=tuple(wanted_simulators(options).arguments()),
        exact=exact,
    )  # fmt: skip


def train(jobs: Sequence[Job], options: argparse.Namespace) -> dict[Job, str]:
    """Train what is not finished. Return the failed runs with the reasons."""
    jobs = [job for job in jobs if not is_deleted(job, options)]
    parallel, begin = options.jobs or 1, start
    if options.backend == "ray" and not all(job.finished() for job in jobs):
        cluster = Cluster(options.cluster, parallel)
        parallel, begin = options.jobs or cluster.room(), cluster.start
    try:
        return run_grid(jobs, parallel, options.output / "metrics", begin)
    except KeyboardInterrupt:
        say("finished runs are kept; repeat the same command to continue")
        raise


def is_finished(job: Job, options: argparse.Namespace) -> bool:
    """Return whether nothing of a run is left to train."""
    return is_deleted(job, options) or job.finished()


def is_deleted(job: Job, options: argparse.Namespace) -> bool:
    """Return whether a finished run was deleted, or is on another machine; its metrics are all that the page needs."""
    return not job.run.exists() and bool(kept_results(job, options.output / "metrics"))


def scored_policy(variant: Variant, spec: pb.GameSpec, behavior: str | None) -> str:
    """Return the policy whose metrics are compared; "" for the only policy of a game. Raises ConfigError.

    It is the last one of the behavior: of axes and buttons the one with the buttons, as in the paper.
    """
    names = [each.name for each in spec.behaviors]
    if behavior is not None and behavior not in names:
        raise ConfigError(f"--behavior got {behavior!r}; {spec.name} has {', '.join(names)}")
    roles = list_roles(variant.config.layout, spec)
    index = names.index(behavior) if behavior is not None else 0
    return [role.name for role in roles if role.behavior == index][-1] if len(roles) > 1 else ""


def finished_run(job: Job, policy: str, options: argparse.Namespace) -> Run:
    """Return what a finished run has reached. Raises ConfigError and CheckpointError."""
    path = options.output / "metrics" / ResultName(job.name, job.timesteps, metrics_name(policy)).path
    if not path.exists():
        raise ConfigError(f"{job.run} has no metrics; delete this folder, and repeat the command to train it again")
    return read_run(path, job.seed, options.metric)


def best_run(analysis: Analysis, jobs: Mapping[Job, str]) -> Path:
    """Return the folder of the run with the highest score of the variant with the highest interquartile mean."""
    result = max(analysis.results, key=lambda result: result.iqm.value)
    seed = max(result.runs, key=lambda run: run.score).seed
    return next(job.run for job, label in jobs.items() if (label, job.seed) == (result.label, seed))


def repetition(options: argparse.Namespace) -> str:
    """Return the command that makes the same comparison elsewhere."""
    words = ["joybridge", "compare", options.config]
    words += ["--layouts", *options.layouts] if options.layouts else []
    words += ["--set", *options.set] if options.set else []
    words += ["--seeds", f"{options.seeds}"]
    words += ["--metric", options.metric] if options.metric != "reward" else []
    words += ["--behavior", options.behavior] if options.behavior else []
    words += ["--score", f"{options.score:g}"] if options.score is not None else []
    words += [word for game in options.game for word in ("--game", game)]
    words += ["--simulator", "ADDRESS"] if options.simulator else []
    return shlex.join([*words, "--output", "FOLDER", *options.overrides])
