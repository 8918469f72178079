"""`joybridge export`: the policy of a run as a file that plays without the trainer."""

import argparse
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path

from joybridge.client.command_line import say_next
from joybridge.client.run_command import run_command
from joybridge.client.simulator_source import last_simulators
from joybridge.commands.playing import games_played, open_player, parse_playing, play_spec, playing_parser
from joybridge.contract.places import PYGAME
from joybridge.contract.text import printable


def main(arguments: Sequence[str] | None = None, prog: str = "joybridge") -> int:
    """Run the command line and return its exit status."""
    parser, command = playing_parser(
        prog, "export", "Write the policy of a run as a file that plays without the trainer."
    )
    command.add_argument("output", type=_policy_file, help="e.g. policy.onnx or policy.json")
    command.add_argument(
        "--behavior", default="", metavar="NAME", help="which behavior to export, if the game has several"
    )
    return run_command(_export, parse_playing(parser, command, arguments))


def _policy_file(text: str) -> Path:
    """Return the path of an exported policy. Raises ArgumentTypeError."""
    if not text.endswith((".onnx", ".json")):
        raise argparse.ArgumentTypeError(f"got {text!r}, expected a file whose name ends in .onnx or .json")
    return Path(text)


def _export(options: argparse.Namespace) -> None:
    for name in ("onnx", "onnxruntime"):  # said before a simulator is started
        if find_spec(name) is None:
            raise ModuleNotFoundError(f"no module named {name}", name=name)
    games = games_played(options)
    with open_player(options) as simulator:
        from joybridge.play.export import export

        exported = export(play_spec(options, simulator, games[0]), options.output, behavior=options.behavior)
    print(exported)
    games_of_run = last_simulators(options.run).simulators.games
    programs = [each.removeprefix(PYGAME) for each in games_of_run if each.startswith(PYGAME)]
    if programs and games == [""]:  # a policy of several games sees and controls what they have in common
        # No exported file holds the settings of a program.
        say_next("drive", printable(programs[0]), str(options.output))
