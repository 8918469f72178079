"""`joybridge compare`: its options. What compares is imported when they are known: not all who read them have it."""

import argparse
import re
from collections.abc import Sequence
from pathlib import Path

from joybridge.client.command_line import add_simulator_options, add_trust_option, check_simulator_options
from joybridge.client.run_command import run_command
from joybridge.compare.ranges import PRUNE_FROM, is_fixed
from joybridge.compare.suites import SUITES
from joybridge.compare.tested import EPISODES, add_test_options
from joybridge.compare.variants import TRAINERS
from joybridge.config.errors import ConfigError
from joybridge.config.overrides import add_overrides, parse_overrides
from joybridge.contract.argument_types import at_least, command_parser, share
from joybridge.play.figures import add_figures
from joybridge.play.sweep import read_sweep

SEEDS = 5
TRIALS = 30
OVERRIDE = re.compile(r"[\w.-]+=")  # not a mixture of layouts, as in "hybrid, angle=bucket-5"


def main(arguments: Sequence[str] | None = None, prog: str = "joybridge") -> int:
    """Run the command line, the command first, and return its exit status."""
    return run_command(_run, parse(arguments, prog))


def parse(arguments: Sequence[str] | None, prog: str) -> argparse.Namespace:
    """Return the options."""
    parser, compares = command_parser(
        prog,
        "compare",
        "Train variants of a configuration with several seeds, and write a page that compares them.",
    )
    compares.add_argument("config", nargs="?", help="a YAML file, or the name of an installed one, as in archer/hybrid")
    compares.add_argument(
        "--output",
        type=Path,
        required=True,
        metavar="FOLDER",
        help="for the runs and the page; the same one continues a comparison",
    )
    _add_variants(compares.add_argument_group("what varies"))
    _add_search(compares.add_argument_group("search"))
    _add_runs(compares.add_argument_group("runs"))
    _add_page(compares.add_argument_group("page"))
    add_test_options(compares.add_argument_group("test"))
    add_simulator_options(compares)
    add_trust_option(compares)
    add_overrides(compares, "keys that all variants share, e.g. total_timesteps=100000")
    options = parse_overrides(parser, arguments)
    for name in ("layouts", "tasks", "pairs"):  # overrides may stand behind them
        words = getattr(options, name)
        options.overrides += [word for word in words if OVERRIDE.match(word)]
        setattr(options, name, [word for word in words if not OVERRIDE.match(word)])
    check_simulator_options(parser, options)
    _check_what_varies(parser, options)
    _check_search(parser, options)
    if options.over:
        options.test = options.test or []
    if options.test is not None and (options.search or options.suite):
        option = "--over" if options.over else "--test"
        parser.error(f"{option} is for a comparison of one configuration; compare what a search has found with --also")
    if options.test is None and (options.episodes or options.deterministic):
        parser.error("--episodes and --deterministic are for a test; say what is tested with --test or --over")
    options.episodes = options.episodes or EPISODES
    options.trials, options.seeds = options.trials or TRIALS, options.seeds or SEEDS
    options.first_seed = options.first_seed or 0
    options.prune_from = PRUNE_FROM if options.prune_from is None else options.prune_from
    return options


def _add_variants(group: argparse._ArgumentGroup) -> None:
    group.add_argument(
        "--layouts", nargs="+", default=[], metavar="LAYOUT", help="that are compared, as in hybrid bucket-5 multiagent"
    )
    group.add_argument(
        "--set",
        nargs="+",
        action="extend",
        default=[],
        metavar="KEY=VALUE,VALUE,…",
        help="any other key that varies, as in policy.learning_rate=1e-3,3e-3; all combinations are trained",
    )
    group.add_argument(
        "--change",
        nargs="+",
        action="extend",
        default=[],
        metavar="KEY=VALUE",
        help="one change at a time: each is compared with the configuration as it is; quoted, several keys are one "
        "change, with a name if you like, as in 'eager: policy.gamma=0.9 policy.epochs=8'",
    )
    group.add_argument(
        "--also",
        action="append",
        default=[],
        metavar="CONFIG",
        help="another configuration of the same game that is compared; may be repeated",
    )
    group.add_argument(
        "--beside",
        choices=TRAINERS,
        help="train each variant also with PPO of Stable-Baselines3, on the same environment of Gymnasium",
    )
    group.add_argument(
        "--ppo", default="{}", metavar="JSON", help="further arguments of that PPO, as in '{\"clip_range_vf\": 0.2}'"
    )
    group.add_argument(
        "--suite", choices=SUITES, help="compare on all tasks of a suite instead of one configuration, on one page"
    )
    group.add_argument("--tasks", nargs="+", default=[], metavar="TASK", help="only these tasks of the suite")


def _add_search(group: argparse._ArgumentGroup) -> None:
    group.add_argument(
        "--search",
        nargs="+",
        action="extend",
        default=[],
        metavar="KEY=RANGE",
        help="search for the best settings instead, within ranges and choices: "
        "policy.learning_rate=1e-5..1e-3:log policy.epochs=3..10 layout=hybrid,bucket-11",
    )
    group.add_argument("--trials", type=at_least(1), metavar="N", help=f"trainings of a search; default {TRIALS}")
    group.add_argument(
        "--prune-from",
        type=share,
        metavar="SHARE",
        help="of the training of a trial, after which it is ended if it falls behind; 1: none is. Default: "
        f"{PRUNE_FROM}; choose more if learning begins late",
    )


def _add_runs(group: argparse._ArgumentGroup) -> None:
    group.add_argument("--seeds", type=at_least(1), metavar="N", help=f"runs of each variant; default {SEEDS}")
    group.add_argument(
        "--first-seed",
        type=at_least(0),
        metavar="N",
        help="the seeds count from it; default 0. For runs that do not share a seed with those of an earlier study",
    )
    group.add_argument(
        "--jobs",
        type=at_least(1),
        help="runs that train at the same time, each on two cores; default: 1, on a cluster as many as fit. Tests are "
        "played one after the other",
    )
    group.add_argument(
        "--backend", choices=("local", "ray"), default="local", help="train on this machine, or on a Ray cluster"
    )
    group.add_argument(
        "--cluster", metavar="HOST:PORT", help="of a running Ray cluster; default: start a local one for this command"
    )


def _add_page(group: argparse._ArgumentGroup) -> None:
    group.add_argument(
        "--metric",
        default="reward",
        help="the column of metrics that is compared, as held_out_reward or a metric of the game; default %(default)s",
    )
    group.add_argument("--behavior", metavar="NAME", help="whose metrics are compared; default: the game's first")
    group.add_argument(
        "--pairs",
        nargs="+",
        action="extend",
        default=[],
        metavar="KEY",
        help="test only pairs of variants that differ in one of these keys alone, as in layout; default: all pairs",
    )
    group.add_argument(
        "--score",
        type=float,
        help="the page says how soon each variant reaches it; default: the lowest interquartile mean of a variant",
    )
    add_figures(group)


def _check_what_varies(parser: argparse.ArgumentParser, options: argparse.Namespace) -> None:
    """End the program with a message if it is not clear what is compared."""
    if options.suite and options.config and OVERRIDE.match(options.config):
        options.overrides, options.config = [options.config, *options.overrides], None
    if bool(options.suite) == bool(options.config):
        parser.error("name a configuration, or a suite with --suite")
    if options.suite and (options.search or options.also or options.beside):
        parser.error("--search, --also and --beside are for one configuration, not for a suite")
    if options.suite and options.metric != "reward":
        parser.error("--metric is for one configuration; each task of a suite has its own")
    if options.ppo != "{}" and not (options.suite or options.beside):
        parser.error("--ppo has arguments of another PPO; name that with --beside")
    if options.tasks and not options.suite:
        parser.error("--tasks are those of a suite; name it with --suite")


def _check_search(parser: argparse.ArgumentParser, options: argparse.Namespace) -> None:
    """Tell what is searched from keys with one value. End the program with a message for options that do not fit."""
    fixed = list(filter(is_fixed, options.search))  # they may stand behind what is searched
    if fixed and fixed == options.search:
        parser.error(f"--search {' '.join(fixed)}: nothing varies; write KEY=LOW..HIGH or KEY=VALUE,VALUE")
    options.search = [word for word in options.search if word not in fixed]
    options.overrides += fixed
    if options.search:
        for name in ("layouts", "set", "change", "pairs", "also", "seeds", "first_seed", "score", "beside"):
            if getattr(options, name) not in ([], None):
                parser.error(
                    f"--{name.replace('_', '-')} is not for a search; write what varies as --search KEY=VALUE,VALUE"
                )
    elif options.trials or options.prune_from is not None:
        parser.error("--trials and --prune-from are for a search; say what is searched with --search")


def _run(options: argparse.Namespace) -> int:
    """Compare, or search. Raises ModuleNotFoundError without the extra `compare`, and ConfigError without Optuna."""
    from joybridge.compare.compare import compare

    if options.over:
        options.over = read_sweep(options.over)
    if options.suite:
        from joybridge.compare.suite import compare_suite

        return compare_suite(options, compare)
    if not options.search:
        return compare(options)
    try:
        from joybridge.compare.search import search
    except ModuleNotFoundError as error:
        if (error.name or "").startswith("joybridge"):
            raise
        raise ConfigError(
            f"--search needs the module {error.name}; install it with `pip install 'joybridge[search]'`"
        ) from error
    return search(options)
