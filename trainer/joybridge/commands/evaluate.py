"""`joybridge evaluate`: how well the policy of a run plays."""

import argparse
import json
from collections.abc import Sequence
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

from joybridge.client.command_line import say_next
from joybridge.client.run_command import run_command
from joybridge.commands.playing import add_others, games_played, open_player, parse_playing, play_spec, playing_parser
from joybridge.config.errors import ConfigError
from joybridge.contract.argument_types import Once, at_least
from joybridge.play.figures import add_figures, save_vector
from joybridge.play.sweep import plot, read_sweep, table
from joybridge.progress import say
from joybridge.run.folder import play_config


def main(arguments: Sequence[str] | None = None, prog: str = "joybridge") -> int:
    """Run the command line and return its exit status."""
    return run_command(_evaluate, parse(arguments, prog))


def parse(arguments: Sequence[str] | None, prog: str) -> argparse.Namespace:
    """Return the options."""
    parser, command = playing_parser(prog, "evaluate", "Measure how well the policy of a run plays.")
    command.add_argument("--episodes", type=at_least(1), default=210, help="number of episodes; default %(default)s")
    command.add_argument(
        "--over",
        action=Once,
        metavar="KEY=VALUE,VALUE,…",
        help="evaluate under each value of an option, a parameter or a limit of the hand, as in "
        "parameters.size=0.5,1,2; print a table, and write a plot into the folder of the run",
    )
    command.add_argument(
        "--demos",
        type=Path,
        metavar="DIR",
        help="record what is played in new files of this folder, as demonstrations for `joybridge train --demos`",
    )
    command.add_argument(
        "--inputs",
        action="store_true",
        help="also measure what is pressed and moved: clicks, paths of pointers, reversals of axes",
    )
    command.add_argument(
        "--random",
        action="store_true",
        help="act at random instead, all that the device allows being equally likely: the score of chance",
    )
    add_figures(command)
    command.add_argument("--json", action="store_true", help="print one JSON object as the last line of stdout")
    add_others(command)
    options = parse_playing(parser, command, arguments)
    if options.figures and not options.over:
        parser.error("--figures is for the plot of --over; name the values to play")
    if options.random and (options.deterministic or options.checkpoint):
        parser.error("--random is not the policy; leave out --deterministic and --checkpoint")
    if options.others and options.inputs:
        parser.error("--inputs measures all agents, also those of --others; give one of the two")
    return options


def _evaluate(options: argparse.Namespace) -> None:
    run, sweep = options.run, read_sweep(options.over) if options.over else None
    games = games_played(options)
    if sweep and len(games) > 1:
        raise ConfigError(f"--over is for one game; name it with --only-game: {', '.join(games)}")
    plays = {game: (game, options.overrides) for game in games}
    if sweep:
        own = f"games.{games[0]}." if games[0] and sweep.of_game else ""
        plays = {setting: (games[0], [*options.overrides, own + setting]) for setting in sweep.settings}
    for _, overrides in plays.values():
        play_config(run, overrides)
    with open_player(options) as simulator:
        from joybridge.play.evaluate import evaluate, inputs_table, summary
        from joybridge.policy.config_fit import fitting_spec

        # All of them before the first is played.
        specs = [fitting_spec(simulator, play_config(run, overrides)) for _, overrides in plays.values()]
        results = {
            setting: evaluate(
                replace(play_spec(options, simulator, game), overrides=overrides),
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
            figure, path = plot(sweep, results), sweep.picture(run, "png")
            figure.savefig(path, dpi=120)
            print(path)
            if options.figures:
                print(save_vector(figure, sweep.picture(run, options.figures)))
    if options.inputs:
        print(inputs_table(results))
    if games != [""] or specs[0].HasField("picture"):
        say_next("record", str(run), "play.mp4")
    if options.json:
        objects = {s: {name: result.as_data() for name, result in found.items()} for s, found in results.items()}
        print(json.dumps(objects if sweep or games != [""] else objects[""]))
