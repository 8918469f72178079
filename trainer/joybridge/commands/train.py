"""`joybridge train`: from a configuration to a run."""

import argparse
import os
import shlex
import signal
from _thread import interrupt_main
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from threading import TIMEOUT_MAX, Event, Thread, Timer

from joybridge.client.client import wait_for
from joybridge.client.command_line import (
    LAST_SIMULATORS,
    add_own_game,
    add_simulator_options,
    add_trust_option,
    check_simulator_options,
    say_next,
    wanted_simulators,
)
from joybridge.client.errors import SimulatorError, SimulatorLost
from joybridge.client.run_command import run_command
from joybridge.client.signals import leaving_on_signals
from joybridge.client.simulator_source import (
    Remembered,
    SimulatorSource,
    choose_simulators,
    last_simulators,
    open_simulators,
    remember,
)
from joybridge.config.config import Config, load_config
from joybridge.config.config_files import find_config
from joybridge.config.errors import ConfigError, StorageError
from joybridge.config.overrides import add_overrides, parse_overrides
from joybridge.contract.address import address
from joybridge.contract.argument_types import at_least, command_parser, minutes
from joybridge.demonstrations.files import find_demonstrations
from joybridge.progress import say
from joybridge.run.checkpoint import checkpoints, has_checkpoint, load_checkpoint
from joybridge.run.folder import check_run, run_config, run_name
from joybridge.run.own_code import check_code, sign_code, trust_all
from joybridge.run.run_lock import PARENT_SECONDS, locked
from joybridge.run.sinks import check_sinks
from joybridge.run.sources import changed_sources, note_sources

# What learns is imported when it is needed: torch takes seconds to load, errors should not.


def main(arguments: Sequence[str] | None = None, prog: str = "joybridge") -> int:
    """Run the command line and return its exit status."""
    return run_command(_train, parse(arguments, prog))


def parse(arguments: Sequence[str] | None, prog: str) -> argparse.Namespace:
    """Return the options."""
    parser, train = command_parser(
        prog, "train", "Train policies as a configuration says; the folder of the run has all results."
    )
    train.add_argument("config", help="a YAML file, or the name of an installed one, as in shooting_birds/bucket-11")
    add_overrides(train, "e.g. seed=3 policy.learning_rate=1e-4")
    train.add_argument(
        "--behavior",
        default="",
        metavar="NAME",
        help="the file is one of ML-Agents: use its settings of this behavior, and game=GAME",
    )
    train.add_argument("--run", type=Path, help="folder of the run; default runs/GAME-NAME[-KEY=VALUE…]-sSEED")
    train.add_argument(
        "--from",
        dest="weights_from",
        metavar="RUN",
        help="begin with the policies that another run has trained, and with fresh schedules",
    )
    train.add_argument(
        "--demos",
        metavar="DIR",
        help="clone the demonstrations in this folder; the key `cloning` says whether alone or beside PPO",
    )
    train.add_argument(
        "--minutes",
        type=minutes,
        metavar="M",
        help="stop after so many minutes, as after Ctrl-C; learning rates and other schedules still end at "
        "total_timesteps",
    )
    train.add_argument("--resume", action="store_true", help="continue from the last checkpoint of the run")
    train.add_argument(
        "--record-faults",
        action="store_true",
        help="if a simulator fails, is lost or breaks the contract, or an update diverges, write what led to it into "
        "the folder faults of the run, for `joybridge replay`",
    )
    train.add_argument(
        "--ray",
        type=address,
        metavar="HOST:PORT",
        help="start simulators on the nodes of this Ray cluster; needs `pip install 'joybridge[cluster]'`",
    )
    train.add_argument("--simulators", type=at_least(1), metavar="N", help="how many the cluster starts; default 1")
    train.add_argument(
        "--with-parent",
        action="store_true",
        help="save and exit when stdin closes, for programs that start this one",
    )
    add_simulator_options(train, LAST_SIMULATORS)
    add_trust_option(train)
    options = parse_overrides(parser, arguments)
    check_simulator_options(parser, options)
    if options.ray and options.simulator:
        parser.error("--ray starts simulators, --simulator names running ones; give one of the two")
    if options.simulators and not options.ray:
        parser.error("--simulators says how many a Ray cluster starts; name the cluster with --ray")
    return options


def _train(options: argparse.Namespace) -> None:
    if options.with_parent:
        _end_with_parent()
    path = find_config(options.config)
    if options.weights_from:
        options.overrides.append(f"weights_from={options.weights_from}")
    if options.demos:
        options.overrides.append(f"demonstrations={options.demos}")
    add_own_game(options, [options.config])
    config = load_config(path, options.overrides, options.behavior)
    check_sinks(config.log_to)
    if config.demonstrations:
        find_demonstrations(Path(config.demonstrations))
    run = options.run or Path("runs") / run_name(config, path.stem, options.overrides)
    _check_code_of_runs(options, config, [path.parent, run])
    check_run(config, run, resume=options.resume)
    resume = options.resume and has_checkpoint(run)
    if options.resume and not resume:
        say(f"{run} ended before anything was saved, so it starts over")
    if config.weights_from and not resume:
        load_checkpoint(Path(config.weights_from))
    if resume and config.total_timesteps > (end := run_config(run).total_timesteps):
        say(
            f"{run} is lengthened from {end:,} to {config.total_timesteps:,} timesteps: learning rate, clip range "
            "and entropy coefficient now reach their ends there, so they are higher than they were"
        )
    if options.simulators and options.simulators > config.arenas:
        raise ConfigError(f"--simulators got {options.simulators}, but the run has {config.arenas} arenas to divide")
    if options.resume or config.weights_from:
        last = last_simulators(run if options.resume else Path(config.weights_from or ""))
    else:  # the configuration may be that of another run, whose games are beside it
        beside = last_simulators(path.parent)
        last = beside if beside.simulators.games else Remembered(run)
    simulators = choose_simulators(_wanted(options), last, config, say, trust=options.trust_run)
    patience = PARENT_SECONDS if options.with_parent else 0.0
    with locked(run, patience), open_simulators(simulators, options.wait, say) as connect:
        addresses = connect()
        for place in addresses if options.ray else ():
            wait_for(place, options.wait, say)  # a firewall may be in the way
        with leaving_on_signals():
            from joybridge.ppo.fast.announce import announcing
            from joybridge.run.progress import Display
            from joybridge.run.train import train
            from joybridge.run.training import Audience

        begin = load_checkpoint(run)[1].timesteps if resume else 0  # the last one may be damaged
        heading = f"run {run}: {config.game}, {config.layout}, {begin:,} of {config.end:,} timesteps done"
        remember(run, simulators, say)
        sign_code(run, config, say)
        over = Event()
        try:
            with (
                _noting_sources(run, simulators.games, config),
                Display(heading, config.layout, config.end, begin) as display,
                announcing(display.say),
                _interrupting_after(options.minutes, over),
            ):
                train(
                    config,
                    run,
                    addresses,
                    resume=options.resume,
                    audience=Audience(display.report, display.say),
                    revive=connect,
                    record_faults=options.record_faults,
                )
        except (KeyboardInterrupt, SimulatorError, StorageError) as error:
            refused = isinstance(error, SimulatorError) and not isinstance(error, SimulatorLost)
            if checkpoints(run) or not refused:  # a request that was refused would be refused again
                say(_continuation(run, options))
            if not (isinstance(error, KeyboardInterrupt) and over.is_set() and checkpoints(run)):
                raise
    say_next("evaluate", str(run))


def _check_code_of_runs(options: argparse.Namespace, config: Config, runs: Sequence[Path]) -> None:
    """Raise UntrustedRunError for code that a stranger's run names: one of `runs`, or that of --from."""
    others = [Path(config.weights_from)] if config.weights_from else []
    if options.trust_run:
        trust_all([*runs, *others, *config.opponents.shares])
    for known in filter(has_checkpoint, {*runs}):
        check_code(known, config)
    for other in filter(has_checkpoint, others):
        check_code(other, run_config(other))


@contextmanager
def _interrupting_after(minutes: float | None, over: Event) -> Iterator[None]:
    """Interrupt what the block does after so many minutes, and set `over` then. None: never."""

    def end() -> None:
        over.set()
        _interrupt()

    timer = Timer(min(60.0 * (minutes or 0.0), TIMEOUT_MAX), end)
    timer.daemon = True
    if minutes:
        timer.start()
    try:
        yield
    finally:
        timer.cancel()


@contextmanager
def _noting_sources(run: Path, games: Sequence[str], config: Config) -> Iterator[None]:
    """Say which sources have changed, and keep their marks once something is saved that has been played with them."""
    if not (changed := changed_sources(run, games, config)):
        note_sources(run, games, config)
        yield
        return
    say(f"the files of {', '.join(changed)} have changed since {run} was last trained; it goes on with them")
    saved = checkpoints(run)
    try:
        yield
    except SimulatorError as error:
        if not isinstance(error, SimulatorLost):
            say(f"if the saved episodes do not fit these files, begin new ones with the same policy: --from {run}")
        raise
    finally:
        if checkpoints(run) != saved:
            note_sources(run, games, config)


def _wanted(options: argparse.Namespace) -> SimulatorSource:
    """Return the simulators that the command line of `train` names."""
    return replace(wanted_simulators(options), cluster=options.ray or "", count=options.simulators or 1)


def _continuation(run: Path, options: argparse.Namespace) -> str:
    """Return what is saved of a run that has ended early, and the command that continues it."""
    named = replace(_wanted(options), games=())  # waited for, unlike simulators that the run remembers
    command = ["joybridge", "train", f"{run}/config.yaml", "--run", str(run), "--resume", *named.arguments()]
    saved = checkpoints(run)
    done = f"saved at {int(saved[-1].name):,} timesteps; continue" if saved else "nothing is saved yet; begin again"
    return f"{done} with: {shlex.join(command)}"


def _end_with_parent() -> None:
    """Interrupt this process once stdin, on which nothing is ever written, closes."""

    def watch() -> None:
        with suppress(OSError):  # closed from the beginning
            while os.read(0, 1024):
                pass
        _interrupt()

    Thread(target=watch, daemon=True).start()


def _interrupt() -> None:
    """Interrupt the main thread, so that it saves and ends."""
    if os.name == "nt":  # os.kill would end the process there before it saves
        interrupt_main(signal.SIGTERM)
    else:
        os.kill(os.getpid(), signal.SIGTERM)
