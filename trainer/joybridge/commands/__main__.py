"""The trainer's commands: train, evaluate, record, export."""

import argparse
import json
import os
import shlex
import signal
import sys
from _thread import interrupt_main
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, replace
from importlib.util import find_spec
from pathlib import Path
from threading import Thread
from typing import TYPE_CHECKING

from joybridge.client.client import wait_for
from joybridge.client.command_line import (
    add_own_game,
    add_simulator_options,
    add_trust_option,
    at_least,
    check_simulator_options,
    run_command,
    say,
    say_next,
    seconds,
    wanted_simulators,
)
from joybridge.client.errors import SimulatorError, SimulatorLost
from joybridge.client.signals import leaving_on_signals
from joybridge.client.simulator_source import (
    Remembered,
    Simulators,
    choose_simulators,
    last_simulators,
    open_simulators,
    remember,
)
from joybridge.config.config import load_config
from joybridge.config.config_files import find_config
from joybridge.config.errors import ConfigError, StorageError
from joybridge.config.overrides import add_overrides, parse_overrides
from joybridge.contract.address import address
from joybridge.demonstrations.files import find_demonstrations
from joybridge.play.sweep import plot, read_sweep, table
from joybridge.play.video_formats import video_format
from joybridge.run.checkpoint import checkpoints, has_checkpoint, load_checkpoint
from joybridge.run.folder import check_run, play_config, run_config, run_name
from joybridge.run.origin import remark
from joybridge.run.own_code import check_code, sign_code, trust
from joybridge.run.run_lock import PARENT_SECONDS, locked
from joybridge.run.sinks import check_sinks

if TYPE_CHECKING:
    from joybridge.play.playing import PlaySpec

# What learns and plays is imported by the command that needs it: torch takes seconds to load, errors should not.


def main(arguments: Sequence[str] | None = None, prog: str = "joybridge") -> int:
    """Run the command line and return its exit status."""
    options = parse(arguments, prog)
    return run_command(options.function, options)


def parse(arguments: Sequence[str] | None, prog: str) -> argparse.Namespace:
    """Return the options, with the command as `function`."""
    parser = argparse.ArgumentParser(prog=prog, description="Train agents on any joybridge simulator.")
    commands = parser.add_subparsers(dest="command", required=True)
    shared = argparse.ArgumentParser(add_help=False)
    add_simulator_options(shared, "the simulators of the run's last training, if they answer; otherwise ")
    add_trust_option(shared)
    trains = commands.add_parser("train", parents=[shared], help="train a configuration")
    trains.set_defaults(function=_train)
    trains.add_argument("config", help="a YAML file, or the name of an installed one, as in shooting_birds/bucket-11")
    add_overrides(trains, "e.g. seed=3 policy.learning_rate=1e-4")
    trains.add_argument(
        "--behavior",
        default="",
        metavar="NAME",
        help="the file is one of ML-Agents: use its settings of this behavior, and game=GAME",
    )
    trains.add_argument("--run", type=Path, help="folder of the run; default runs/GAME-NAME[-KEY=VALUE…]-sSEED")
    trains.add_argument(
        "--from",
        dest="weights_from",
        metavar="RUN",
        help="begin with the policies that another run has trained, and with fresh schedules",
    )
    trains.add_argument(
        "--demos",
        metavar="DIR",
        help="clone the demonstrations in this folder; the key `cloning` says whether alone or beside PPO",
    )
    trains.add_argument("--resume", action="store_true", help="continue from the last checkpoint of the run")
    trains.add_argument(
        "--record-faults",
        action="store_true",
        help="if a simulator fails, is lost or breaks the contract, or an update diverges, write what led to it into "
        "the folder faults of the run, for `joybridge replay`",
    )
    trains.add_argument(
        "--ray",
        type=address,
        metavar="HOST:PORT",
        help="start simulators on the nodes of this Ray cluster; needs `pip install 'joybridge[cluster]'`",
    )
    trains.add_argument("--simulators", type=at_least(1), metavar="N", help="how many the cluster starts; default 1")
    trains.add_argument(
        "--with-parent",
        action="store_true",
        help="save and exit when stdin closes, for programs that start this one",
    )
    plays = argparse.ArgumentParser(add_help=False)
    plays.add_argument("run", type=Path, help="folder of a run")
    plays.add_argument(
        "--seed", type=at_least(0), default=1, help="seed of environments and action sampling; default %(default)s"
    )
    plays.add_argument(
        "--checkpoint", default="", metavar="WHICH", help="timesteps of a checkpoint, or best; default: the newest"
    )
    plays.add_argument(
        "--only-game", default="", metavar="NAME", help="play only this one of the several games of the run"
    )
    plays.add_argument("--deterministic", action="store_true", help="take the most probable action instead of sampling")
    evaluates = commands.add_parser("evaluate", parents=[plays, shared], help="measure how well a run's policy plays")
    evaluates.set_defaults(function=_evaluate)
    evaluates.add_argument("--episodes", type=at_least(1), default=210, help="number of episodes; default %(default)s")
    evaluates.add_argument(
        "--over",
        metavar="KEY=VALUE,VALUE,…",
        help="evaluate under each value of an option or a parameter, as in parameters.size=0.5,1,2; print a table, and "
        "write a plot into the folder of the run",
    )
    evaluates.add_argument(
        "--demos",
        type=Path,
        metavar="DIR",
        help="record what is played in new files of this folder, as demonstrations for `joybridge train --demos`",
    )
    evaluates.add_argument(
        "--inputs",
        action="store_true",
        help="also measure what is pressed and moved: clicks, paths of pointers, reversals of axes",
    )
    evaluates.add_argument("--json", action="store_true", help="print one JSON object as the last line of stdout")
    records = commands.add_parser("record", parents=[plays, shared], help="record a video of a run's policy")
    records.set_defaults(function=_record)
    records.add_argument("output", type=Path, help="e.g. play.mp4 or play.gif")
    records.add_argument("--seconds", type=seconds, default=40.0, help="length of the video; default %(default)g")
    records.add_argument("--inputs", action="store_true", help="below the picture, draw what the policy presses")

    exports = commands.add_parser(
        "export", parents=[plays, shared], help="write a run's policy as a file that plays without the trainer"
    )
    exports.set_defaults(function=_export)
    exports.add_argument("output", type=_policy_file, help="e.g. policy.onnx or policy.json")
    exports.add_argument(
        "--behavior", default="", metavar="NAME", help="which behavior to export, if the game has several"
    )

    for with_others in (evaluates, records):
        with_others.add_argument(
            "--others",
            action="append",
            default=[],
            metavar="WHO",
            help="who holds all seats but one of each arena, in a game of several agents: the folder of a run, "
            "script:NAME, a script of the game's author, or an exported policy.json; given several times, they take "
            "seats in turn",
        )
    for plays_run in (evaluates, records, exports):
        add_overrides(
            plays_run, "options and parameters of the game that differ from the training, e.g. parameters.size=0.5"
        )

    options = parse_overrides(parser, arguments)
    check_simulator_options(parser, options)
    if options.trust_run and options.command != "train":
        trust(options.run)
    if options.command != "train" and len(options.simulator) > 1:
        parser.error(f"{options.command} uses one simulator, got {len(options.simulator)}")
    if options.command == "evaluate" and options.others and options.inputs:
        parser.error("--inputs measures all agents, also those of --others; give one of the two")
    if options.command == "train" and options.ray and options.simulator:
        parser.error("--ray starts simulators, --simulator names running ones; give one of the two")
    if options.command == "train" and options.simulators and not options.ray:
        parser.error("--simulators says how many a Ray cluster starts; name the cluster with --ray")
    return options


def _policy_file(text: str) -> Path:
    """Return the path of an exported policy. Raises ArgumentTypeError."""
    if not text.endswith((".onnx", ".json")):
        raise argparse.ArgumentTypeError(f"got {text!r}, expected a file whose name ends in .onnx or .json")
    return Path(text)


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
    for known in filter(has_checkpoint, {path.parent, run}):  # they may be a stranger's
        if options.trust_run:
            trust(known)
        check_code(known, config)
    check_run(config, run, resume=options.resume)
    resume = options.resume and has_checkpoint(run)
    if options.resume and not resume:
        say(f"{run} ended before anything was saved: it begins anew")
    if config.weights_from and not resume:
        load_checkpoint(Path(config.weights_from))
    if resume and config.total_timesteps > (before := run_config(run).total_timesteps):
        say(
            f"{run} is lengthened from {before:,} to {config.total_timesteps:,} timesteps: learning rate, clip range "
            "and entropy coefficient now reach their ends there, so they are higher than they were"
        )
    if options.simulators and options.simulators > config.arenas:
        raise ConfigError(f"--simulators got {options.simulators}, but the run has {config.arenas} arenas to divide")
    source = run if options.resume else Path(config.weights_from) if config.weights_from else None
    last = last_simulators(source) if source else Remembered(run)
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

        saved = checkpoints(run)
        begin = int(saved[-1].name) if saved else 0
        heading = f"run {run}: {config.game}, {config.layout}, {begin:,} of {config.end:,} timesteps done"
        remember(run, simulators, say)
        sign_code(run, config, say)
        try:
            with Display(heading, config.layout, config.end, begin) as display, announcing(display.say):
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
            raise
    say_next("evaluate", str(run))


def _wanted(options: argparse.Namespace) -> Simulators:
    """Return the simulators that the command line of `train` names."""
    return replace(wanted_simulators(options), cluster=options.ray or "", count=options.simulators or 1)


def _continuation(run: Path, options: argparse.Namespace) -> str:
    """Return what is saved of a run that has ended early, and the command that continues it."""
    named = replace(_wanted(options), games=())  # waited for, unlike simulators that the run remembers
    command = ["joybridge", "train", f"{run}/config.yaml", "--run", str(run), "--resume", *named.arguments()]
    saved = checkpoints(run)
    done = f"saved at {int(saved[-1].name):,} timesteps; continue" if saved else "nothing is saved yet; begin again"
    return f"{done} with: {shlex.join(command)}"


def _evaluate(options: argparse.Namespace) -> None:
    run, sweep = options.run, read_sweep(options.over) if options.over else None
    games = _games(options)
    if sweep and len(games) > 1:
        raise ConfigError(f"--over is for one game; name it with --only-game: {', '.join(games)}")
    plays = {game: (game, options.overrides) for game in games}
    if sweep:
        plays = {setting: (games[0], [*options.overrides, setting]) for setting in sweep.settings}
    for _, overrides in plays.values():
        play_config(run, overrides)
    with _player(options) as simulator:
        from joybridge.play.evaluate import evaluate, inputs_table, summary
        from joybridge.policy.config_fit import fitting_spec

        for _, overrides in plays.values():  # all of them before the first is played
            fitting_spec(simulator, play_config(run, overrides))
        results = {
            setting: evaluate(
                replace(_play_spec(options, simulator, game), overrides=overrides),
                episodes=options.episodes,
                say=say,
                demos=options.demos,
                inputs=options.inputs,
            )
            for setting, (game, overrides) in plays.items()
        }
    if not sweep:
        for game, found in results.items():
            print(summary({f"{game}: {name}" if game else name: result for name, result in found.items()}))
    else:
        print(table(sweep, results))
        if find_spec("matplotlib") is None:
            say("no plot: the module matplotlib is missing; install it with `pip install 'joybridge[report]'`")
        else:
            plot(sweep, results, sweep.picture(run))
            print(sweep.picture(run))
    if options.inputs:
        print(inputs_table(results))
    say_next("record", str(run), "play.mp4")
    if options.json:
        objects = {s: {name: asdict(result) for name, result in found.items()} for s, found in results.items()}
        print(json.dumps(objects if sweep or games != [""] else objects[""]))


def _games(options: argparse.Namespace) -> list[str]:
    """Return which of several games a command plays; "": the run has one. Raises ConfigError."""
    config = play_config(options.run, options.overrides)
    if options.only_game:
        config.of_game(options.only_game)
    return [options.only_game] if options.only_game else [*config.games] or [""]


def _record(options: argparse.Namespace) -> None:
    video_format(options.output)
    games = _games(options)
    if len(games) > 1 and options.inputs:
        raise ConfigError(f"--inputs is for one game; name it with --only-game: {', '.join(games)}")
    with _player(options) as simulator:
        from joybridge.play.record import record
        from joybridge.play.record_games import record_games

        plays = _play_spec(options, simulator, games[0])
        if len(games) > 1:
            frames = record_games(plays, options.output, games=games, seconds=options.seconds)
        else:
            frames = record(plays, options.output, seconds=options.seconds, say=say, inputs=options.inputs)
    print(f"{options.output}: {frames} frames")
    say_next("export", str(options.run), "policy.onnx")


def _export(options: argparse.Namespace) -> None:
    games = _games(options)
    with _player(options) as simulator:
        from joybridge.play.export import export

        exported = export(_play_spec(options, simulator, games[0]), options.output, behavior=options.behavior)
    print(exported)


def _play_spec(options: argparse.Namespace, address: str, game: str) -> "PlaySpec":
    """Return what the command line lets play at the simulator at an address."""
    from joybridge.play.playing import PlaySpec

    return PlaySpec(
        options.run,
        address,
        options.seed,
        options.deterministic,
        options.overrides,
        options.checkpoint,
        getattr(options, "others", ()),
        game,
    )


@contextmanager
def _player(options: argparse.Namespace) -> Iterator[str]:
    """Yield the address of a simulator for a run, after its configuration and its checkpoint have been checked."""
    config = play_config(options.run, options.overrides)
    if text := remark(load_checkpoint(options.run, options.checkpoint)[1].origin):
        say(text)
    last = last_simulators(options.run)
    simulators = choose_simulators(wanted_simulators(options), last, config, say, trust=options.trust_run)
    with open_simulators(simulators, options.wait, say) as connect:
        yield connect()[0]


def _end_with_parent() -> None:
    """Interrupt this process once stdin, on which nothing is ever written, closes."""

    def watch() -> None:
        with suppress(OSError):  # closed from the beginning
            while os.read(0, 1024):
                pass
        if os.name == "nt":  # os.kill would end the process there before it saves
            interrupt_main(signal.SIGTERM)
        else:
            os.kill(os.getpid(), signal.SIGTERM)

    Thread(target=watch, daemon=True).start()


if __name__ == "__main__":
    sys.exit(main())
