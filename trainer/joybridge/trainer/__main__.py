"""The trainer's command line: train, evaluate, record."""

import argparse
import json
import os
import signal
import sys
from collections.abc import Sequence
from contextlib import ExitStack, suppress
from dataclasses import asdict
from pathlib import Path
from threading import Thread

from joybridge.trainer.agent import DivergedError
from joybridge.trainer.checkpoint import CheckpointError, has_checkpoint, load_checkpoint
from joybridge.trainer.config import ConfigError, load_config
from joybridge.trainer.evaluate import evaluate
from joybridge.trainer.progress import Display
from joybridge.trainer.record import record
from joybridge.trainer.train import train
from joybridge.trainer.wire.client import SimulatorError, wait_for
from joybridge.trainer.wire.launch import simulator_process

ERRORS = (CheckpointError, ConfigError, DivergedError, SimulatorError)


def main(arguments: Sequence[str] | None = None, prog: str = "python -m joybridge.trainer") -> int:
    """Run the command line and return its exit status."""
    parser = argparse.ArgumentParser(prog=prog, description="Train agents on any joybridge simulator.")
    commands = parser.add_subparsers(dest="command", required=True)
    shared = argparse.ArgumentParser(add_help=False)
    shared.add_argument(
        "--simulator",
        action="append",
        default=[],
        metavar="ADDRESS",
        help="HOST:PORT or unix:PATH of a running simulator (repeated, training spreads its arenas over several); "
        "without, one is started and ended with this command",
    )
    shared.add_argument("--wait", type=float, default=60.0, help="seconds to wait for it; default %(default)g")
    shared.add_argument(
        "--game",
        action="append",
        default=[],
        metavar="MODULE:CLASS",
        help="a further game for the simulator that is started",
    )
    trains = commands.add_parser("train", parents=[shared], help="train a configuration")
    trains.add_argument("config", type=Path, help="a YAML file, see configs/")
    trains.add_argument("overrides", nargs="*", metavar="key=value", help="e.g. seed=3 policy.learning_rate=1e-4")
    trains.add_argument("--run", type=Path, help="folder of the run; default runs/GAME-NAME-sSEED")
    trains.add_argument("--resume", action="store_true", help="go on from the run's last checkpoint")
    trains.add_argument(
        "--with-parent", action="store_true", help="save and end when standard input closes: for programs that start it"
    )
    plays = argparse.ArgumentParser(add_help=False)
    plays.add_argument("run", type=Path, help="folder of a run")
    plays.add_argument("--seed", type=int, default=1, help="of games and samples; default %(default)s")
    plays.add_argument("--deterministic", action="store_true", help="always the likeliest action, no sampling")
    evaluates = commands.add_parser("evaluate", parents=[plays, shared], help="say how well a run's policy plays")
    evaluates.add_argument("--episodes", type=int, default=210, help="at least so many; default %(default)s")
    evaluates.add_argument("--json", action="store_true", help="print one JSON object as the last line of stdout")
    records = commands.add_parser("record", parents=[plays, shared], help="record a run's policy as an mp4")
    records.add_argument("output", type=Path, help="e.g. play.mp4")
    records.add_argument("--seconds", type=float, default=40.0, help="length of the video; default %(default)g")
    options, rest = parser.parse_known_args(arguments)
    if options.command != "train" or any(text.startswith("-") for text in rest):
        parser.parse_args(arguments)  # ends with argparse's own message where there is anything unknown
    else:
        options.overrides += rest  # argparse does not see key=value pairs that stand after an option

    if options.simulator and options.game:
        parser.error(
            "--game is for a simulator that is started here; give it to the one that runs, without --simulator"
        )
    if options.command != "train" and len(options.simulator) > 1:
        parser.error(f"{options.command} plays at one simulator; {len(options.simulator)} are given")
    signal.signal(signal.SIGINT, signal.default_int_handler)  # which shells switch off for what runs in the background
    signal.signal(signal.SIGTERM, lambda *_: signal.raise_signal(signal.SIGINT))
    try:
        with ExitStack() as stack:
            addresses = options.simulator or [stack.enter_context(simulator_process(options.game))]
            for address in addresses:
                wait_for(address, options.wait, _say)
            {"train": _train, "evaluate": _evaluate, "record": _record}[options.command](options, addresses)
    except ERRORS as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return 130
    return 0


def _end_with_parent() -> None:
    """Interrupt this process once standard input, on which nothing is ever written, closes."""

    def watch() -> None:
        with suppress(OSError):  # closed from the beginning
            while os.read(0, 1024):
                pass
        os.kill(os.getpid(), signal.SIGTERM)

    Thread(target=watch, daemon=True).start()


def _train(options: argparse.Namespace, addresses: list[str]) -> None:
    if options.with_parent:
        _end_with_parent()
    config = load_config(options.config, options.overrides)
    run = options.run or Path("runs") / f"{config.game}-{options.config.stem}-s{config.seed}"
    begin = load_checkpoint(run)[1]["timesteps"] if options.resume else 0
    print(f"run {run}: {config.game}, {config.layout}, {begin:,} of {config.end:,} timesteps done", flush=True)
    try:
        with Display(config.layout, config.end, begin) as display:
            train(config, run, addresses, resume=options.resume, report=display.report)
    except (KeyboardInterrupt, SimulatorError):
        if has_checkpoint(run):
            places = [f" --{name} {value}" for name in ("simulator", "game") for value in getattr(options, name)]
            _say(f"saved; go on with: joybridge train {run}/config.yaml --run {run} --resume{''.join(places)}")
        raise


def _evaluate(options: argparse.Namespace, addresses: list[str]) -> None:
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


def _record(options: argparse.Namespace, addresses: list[str]) -> None:
    frames = record(
        options.run, addresses[0], options.output, seconds=options.seconds, seed=options.seed,
        deterministic=options.deterministic, say=_say,
    )  # fmt: skip
    print(f"{options.output}: {frames} frames")


def _say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


if __name__ == "__main__":
    sys.exit(main())
