"""`joybridge tape`: record and replay input tapes of pygame programs."""

import argparse
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path

from joybridge.adapters.pygame_programs.tape import read_tape
from joybridge.adapters.tapes import record, replay
from joybridge.contract.argument_types import SEEDS, at_least, command_parser
from joybridge.contract.errors import JoybridgeError
from joybridge.simulator.program_options import split_arguments


def main(arguments: Sequence[str] | None = None, prog: str = "joybridge") -> int:
    """Run the command line, `tape` first, and return its exit status."""
    words, own = split_arguments(sys.argv[1:] if arguments is None else arguments)
    options = _parse(words, prog)
    try:
        if options.what == "record":
            program = shlex.join([options.program, *options.settings, *(["--", *own] if own else [])])
            frames = record(program, options.tape, seed=options.seed, decisions=options.decisions)
            decisions = len(read_tape(Path(options.tape)).acts)
            print(f"{options.tape}: {decisions} decisions, {frames} frames")
            print(f"next: {shlex.join(['joybridge', 'tape', 'replay', options.tape])}")
        else:
            print(f"{replay(options.tape, options.program)} frames are as on the tape")
    except JoybridgeError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    return 0


def _parse(arguments: Sequence[str], prog: str) -> argparse.Namespace:
    parser, tape = command_parser(
        prog,
        "tape",
        "Regression tests of a pygame program: a tape has what was pressed, and a hash of each frame.",
    )
    whats = tape.add_subparsers(dest="what", required=True)
    records = whats.add_parser("record", help="write a tape of random play")
    records.add_argument("program", metavar="PROGRAM", help="FILE, MODULE or PACKAGE:SCRIPT; its arguments follow --")
    records.add_argument("tape", help="e.g. opening.tape")
    records.add_argument("settings", nargs="*", default=[], metavar="KEY=VALUE", help="of the program, as in serve")
    records.add_argument("--decisions", type=at_least(1), default=256, help="most of them; default %(default)s")
    records.add_argument(
        "--seed", type=at_least(0, SEEDS), default=0, help="of the program and of the play; default %(default)s"
    )
    replays = whats.add_parser("replay", help="play a tape again: 1 is returned if a frame differs")
    replays.add_argument("tape", help="the file")
    replays.add_argument(
        "--program", default="", help="where it is now; in quotes with its settings, if they are not those of the tape"
    )
    options, others = parser.parse_known_args(arguments)
    settings = [word for word in others if options.what == "record" and "=" in word and not word.startswith("-")]
    if wrong := [word for word in others if word not in settings]:
        parser.error(f"unrecognized arguments: {' '.join(wrong)}")
    if settings:  # they may stand behind the options
        options.settings += settings
    return options
