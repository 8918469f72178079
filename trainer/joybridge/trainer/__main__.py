"""The trainer's commands: train, evaluate, record."""

import argparse
import json
import math
import os
import shlex
import signal
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict
from pathlib import Path
from threading import Thread

from joybridge.contract.address import address
from joybridge.contract.errors import JoybridgeError
from joybridge.trainer.checkpoint import has_checkpoint, load_checkpoint
from joybridge.trainer.config import check_run, load_config, run_config
from joybridge.trainer.config_files import find_config
from joybridge.trainer.wire.client import SimulatorError, wait_for
from joybridge.trainer.wire.launch import simulator_process

# What learns and plays is imported by the command that needs it: torch takes seconds to load, errors should not.


def main(arguments: Sequence[str] | None = None, prog: str = "python -m joybridge.trainer") -> int:
    """Run the command line and return its exit status."""
    options = parse(arguments, prog)
    signal.signal(signal.SIGINT, signal.default_int_handler)  # shells turn it off for programs in the background
    signal.signal(signal.SIGTERM, lambda *_: signal.raise_signal(signal.SIGINT))
    try:
        options.function(options)
    except JoybridgeError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return 130
    return 0


def parse(arguments: Sequence[str] | None, prog: str) -> argparse.Namespace:
    """Return the options, with the command as `function`."""
    parser = argparse.ArgumentParser(prog=prog, description="Train agents on any joybridge simulator.")
    commands = parser.add_subparsers(dest="command", required=True)
    shared = argparse.ArgumentParser(add_help=False)
    shared.add_argument(
        "--simulator", action="append", type=address, default=[], metavar="ADDRESS",
        help="HOST:PORT or unix:PATH of a running simulator; repeat it to divide the arenas of a training among "
        "several. Without it, this command starts a simulator and ends it",
    )  # fmt: skip
    shared.add_argument(
        "--wait", type=_seconds, default=60.0, metavar="SECONDS",
        help="how long to wait for a simulator that does not answer yet; default %(default)g",
    )  # fmt: skip
    shared.add_argument(
        "--game", action="append", default=[], metavar="MODULE:CLASS",
        help="another game for the simulator that this command starts; the current folder is searched first",
    )  # fmt: skip
    trains = commands.add_parser("train", parents=[shared], help="train a configuration")
    trains.set_defaults(function=_train)
    trains.add_argument("config", help="a YAML file, or the name of an installed one, as in shooting_birds/bucket-11")
    trains.add_argument("overrides", nargs="*", metavar="key=value", help="e.g. seed=3 policy.learning_rate=1e-4")
    trains.add_argument("--run", type=Path, help="folder of the run; default runs/GAME-NAME-sSEED")
    trains.add_argument("--resume", action="store_true", help="continue from the last checkpoint of the run")
    trains.add_argument(
        "--with-parent", action="store_true",
        help="save and exit when stdin closes, for programs that start this one",
    )  # fmt: skip
    plays = argparse.ArgumentParser(add_help=False)
    plays.add_argument("run", type=Path, help="folder of a run")
    plays.add_argument(
        "--seed", type=_at_least(0), default=1, help="seed of environments and action sampling; default %(default)s"
    )
    plays.add_argument("--deterministic", action="store_true", help="take the most probable action instead of sampling")
    evaluates = commands.add_parser("evaluate", parents=[plays, shared], help="measure how well a run's policy plays")
    evaluates.set_defaults(function=_evaluate)
    evaluates.add_argument(
        "--episodes", type=_at_least(1), default=210, help="minimum number of episodes; default %(default)s"
    )
    evaluates.add_argument("--json", action="store_true", help="print one JSON object as the last line of stdout")
    records = commands.add_parser("record", parents=[plays, shared], help="record a video of a run's policy")
    records.set_defaults(function=_record)
    records.add_argument("output", type=Path, help="e.g. play.mp4")
    records.add_argument("--seconds", type=_seconds, default=40.0, help="length of the video; default %(default)g")

    options, rest = parser.parse_known_args(arguments)
    if options.command != "train" or any(text.startswith("-") for text in rest):
        parser.parse_args(arguments)  # reports what is unknown
    else:
        options.overrides += rest  # argparse does not see key=value pairs that follow an option
    if options.simulator and options.game:
        parser.error("--game is for a simulator that this command starts; give it to the running one instead")
    if options.command != "train" and len(options.simulator) > 1:
        parser.error(f"{options.command} uses one simulator, got {len(options.simulator)}")
    return options


def _at_least(least: int) -> Callable[[str], int]:
    """Return a function that reads an integer of at least `least`, or raises ArgumentTypeError."""

    def number(text: str) -> int:
        if not text.isdecimal() or int(text) < least:
            raise argparse.ArgumentTypeError(f"got {text!r}, expected an integer of at least {least}")
        return int(text)

    return number


def _seconds(text: str) -> float:
    """Return a positive time in seconds. Raises ArgumentTypeError."""
    try:
        seconds = float(text)
    except ValueError:
        seconds = math.nan
    if not (math.isfinite(seconds) and seconds > 0):
        raise argparse.ArgumentTypeError(f"got {text!r}, expected a positive number of seconds")
    return seconds


def _train(options: argparse.Namespace) -> None:
    if options.with_parent:
        _end_with_parent()
    path = find_config(options.config)
    config = load_config(path, options.overrides)
    run = options.run or Path("runs") / f"{config.game}-{path.stem}-s{config.seed}"
    check_run(config, run, resume=options.resume)
    begin = load_checkpoint(run)[1]["timesteps"] if options.resume else 0
    with _simulators(options) as addresses:
        from joybridge.trainer.progress import Display
        from joybridge.trainer.train import train

        print(f"run {run}: {config.game}, {config.layout}, {begin:,} of {config.end:,} timesteps done", flush=True)
        try:
            with Display(config.layout, config.end, begin) as display:
                train(config, run, addresses, resume=options.resume, report=display.report)
        except (KeyboardInterrupt, SimulatorError):
            if has_checkpoint(run):
                command = ["joybridge", "train", f"{run}/config.yaml", "--run", str(run), "--resume"]
                for name in ("simulator", "game"):
                    for value in getattr(options, name):
                        command += [f"--{name}", value]
                _say(f"saved; continue with: {shlex.join(command)}")
            raise


def _evaluate(options: argparse.Namespace) -> None:
    _check_played(options.run)
    with _simulators(options) as addresses:
        from joybridge.trainer.evaluate import evaluate

        evaluations = evaluate(
            options.run, addresses[0], episodes=options.episodes, seed=options.seed,
            deterministic=options.deterministic, say=_say,
        )  # fmt: skip
    for name, result in evaluations.items():
        print(f"{name}: {result.episodes} episodes after {result.timesteps:,} timesteps, mean and 95 % confidence")
        for metric, mean in result.means.items():
            print(f"  {metric:<16} {mean:10.3f} ± {result.half_widths[metric]:.3f}")
        if result.by_choice:
            print("  reward by choice " + "  ".join(f"{c}: {mean:.1f}" for c, mean in result.by_choice.items()))
    if options.json:
        print(json.dumps({name: asdict(result) for name, result in evaluations.items()}))


def _record(options: argparse.Namespace) -> None:
    _check_played(options.run)
    with _simulators(options) as addresses:
        from joybridge.trainer.record import record

        frames = record(
            options.run, addresses[0], options.output, seconds=options.seconds, seed=options.seed,
            deterministic=options.deterministic, say=_say,
        )  # fmt: skip
    print(f"{options.output}: {frames} frames")


def _check_played(run: Path) -> None:
    """Raise ConfigError or CheckpointError unless a run can be played, before anything is started."""
    run_config(run)
    load_checkpoint(run)


@contextmanager
def _simulators(options: argparse.Namespace) -> Iterator[list[str]]:
    """Yield the addresses of simulators that answer: the given ones, or that of one that is started and ended here."""
    if options.simulator:
        for place in options.simulator:
            wait_for(place, options.wait, _say)
        yield options.simulator
        return
    with simulator_process(options.game) as place:
        yield [place]


def _end_with_parent() -> None:
    """Interrupt this process once stdin, on which nothing is ever written, closes."""

    def watch() -> None:
        with suppress(OSError):  # closed from the beginning
            while os.read(0, 1024):
                pass
        os.kill(os.getpid(), signal.SIGTERM)

    Thread(target=watch, daemon=True).start()


def _say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


if __name__ == "__main__":
    sys.exit(main())
