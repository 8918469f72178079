"""`joybridge record`: a video of what the policy of a run plays."""

import argparse
from collections.abc import Sequence
from pathlib import Path

from joybridge.client.command_line import say_next
from joybridge.client.run_command import run_command
from joybridge.commands.playing import add_others, games_played, open_player, parse_playing, play_spec, playing_parser
from joybridge.config.errors import ConfigError
from joybridge.contract.argument_types import at_least, seconds
from joybridge.layouts import list_roles
from joybridge.play.video_formats import video_format
from joybridge.policy.exportable import export_refusal
from joybridge.progress import say
from joybridge.run.folder import play_config, run_spec


def main(arguments: Sequence[str] | None = None, prog: str = "joybridge") -> int:
    """Run the command line and return its exit status."""
    parser, command = playing_parser(prog, "record", "Record a video of the policy of a run.")
    command.add_argument("output", type=Path, help="e.g. play.mp4 or play.gif")
    length = command.add_mutually_exclusive_group()
    length.add_argument("--seconds", type=seconds, default=40.0, help="length of the video; default %(default)g")
    length.add_argument("--episodes", type=at_least(1), help="record so many whole episodes, however long they are")
    command.add_argument("--inputs", action="store_true", help="below the picture, draw what the policy presses")
    add_others(command)
    return run_command(_record, parse_playing(parser, command, arguments))


def _record(options: argparse.Namespace) -> None:
    video_format(options.output)
    games = games_played(options)
    if len(games) > 1 and (options.inputs or options.episodes):
        what = "--inputs" if options.inputs else "--episodes"
        raise ConfigError(f"{what} is for one game; name it with --only-game: {', '.join(games)}")
    with open_player(options) as simulator:
        from joybridge.play.record import record
        from joybridge.play.record_games import record_games

        plays = play_spec(options, simulator, games[0])
        if len(games) > 1:
            frames = record_games(plays, options.output, games=games, seconds=options.seconds)
        else:
            length = None if options.episodes else options.seconds
            frames = record(plays, options.output, length, options.episodes, say=say, inputs=options.inputs)
    print(f"{options.output}: {frames} frames")
    say_next(
        *(["export", str(options.run), "policy.onnx"] if _can_be_exported(options) else ["watch", str(options.run)])
    )


def _can_be_exported(options: argparse.Namespace) -> bool:
    """Return whether a file can hold all policies of the run."""
    config = play_config(options.run, options.overrides)
    try:
        roles = list_roles(config.layout, run_spec(options.run))
    except ConfigError:  # a run of an older version has no spec
        return False
    return not any(export_refusal(config, role) for role in roles)
