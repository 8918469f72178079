"""`joybridge play`: play a game in the browser."""

import argparse
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from joybridge.client.client import describe
from joybridge.client.own_games import choose_game
from joybridge.client.run_command import add_one_simulator, protected, run_command, search_here
from joybridge.config.errors import ConfigError
from joybridge.config.game_or_config import game_or_config
from joybridge.config.game_settings import check_settings
from joybridge.config.overrides import add_overrides, parse_overrides
from joybridge.contract.argument_types import SEEDS, at_least, command_parser, seconds
from joybridge.contract.codec import lane_count
from joybridge.contract.credentials import check_credentials
from joybridge.viewer.page_options import add_page_options

if TYPE_CHECKING:
    from joybridge.viewer.arena import Settings
    from joybridge.viewer.page_session import PageGame

# What serves the page is imported by the command that needs it: help and errors need no further package.


def main(arguments: Sequence[str] | None = None, prog: str = "joybridge") -> int:
    """Run the command line, the command first, and return its exit status."""
    return run_command(_play, _parse(arguments, prog))


def _play(options: argparse.Namespace) -> None:
    from joybridge.viewer.arena import Settings
    from joybridge.viewer.page_session import welcome
    from joybridge.viewer.simulator import Simulator
    from joybridge.viewer.web import open_website, show

    search_here()
    named, chosen = game_or_config(options.what, options.overrides)
    settings = Settings(options.seed, chosen.options, chosen.parameters)
    place = protected(options.simulator, options) if options.simulator else None
    game, games = choose_game(named, options.game, place)
    with Simulator(place, games) as simulator:
        what, settings = _what(options, game, settings)
        spec = describe(simulator.reach(), game, settings.options)
        check_settings(settings.options, settings.parameters, spec)
        _check_seats(options, game, sum(lane_count(behavior, 1) for behavior in spec.behaviors))
        with open_website(options.port, welcome(simulator, what, settings)) as url:
            recorded = f"what you play is recorded in {options.demos}\n" if options.demos else ""
            together = f"open it in {what.people} tabs, one for each player\n" if what.people > 1 else ""
            print(f"play {game} at {url}\n{together}{recorded}Ctrl-C ends it", flush=True)
            show(url, browser=not options.no_browser)


def _parse(arguments: Sequence[str] | None, prog: str) -> argparse.Namespace:
    parser, play = command_parser(
        prog,
        "play",
        "Play a game in the browser, with pointer, keys or gamepad.",
    )
    play.add_argument(
        "what",
        metavar="GAME|CONFIG",
        help="a game, by its name or as MODULE:CLASS, or a configuration, with its options and parameters",
    )
    add_one_simulator(play)
    play.add_argument("--seed", type=at_least(0, SEEDS), default=0, help="of the game; default %(default)s")
    play.add_argument(
        "--timeout",
        type=seconds,
        default=10.0,
        metavar="SECONDS",
        help="how long to wait for an answer of the simulator before it is taken for lost; default %(default)g",
    )
    play.add_argument(
        "--against",
        type=Path,
        metavar="RUN",
        help="let the policy of a run play beside you, on the same seed; its options and parameters are the defaults",
    )
    play.add_argument(
        "--others",
        action="append",
        default=[],
        metavar="WHO",
        help="who holds the seats that you do not hold, in a game of several agents: the folder of a run, whose "
        "options and parameters are the defaults, script:NAME, a script of the game's author, or an exported "
        "policy.json; given several times, they take seats in turn; without it these seats play random decisions",
    )
    play.add_argument(
        "--players",
        type=at_least(1),
        default=1,
        metavar="N",
        help="people who play one match together, each in a tab of their own, in the first seats; it waits until all "
        "are there; default 1: every tab plays a game of its own",
    )
    play.add_argument(
        "--rate",
        action="append",
        default=[],
        metavar="NAME",
        help="log your matches under this name, for `joybridge rate`, in the folder rating of the first run of "
        "--others, or of the current folder. Matches count in which you keep one seat. With --players, repeat it for "
        "each who agrees to be rated, in the order of their seats",
    )
    play.add_argument(
        "--demos",
        type=Path,
        metavar="DIR",
        help="record what you play in new files of this folder, as demonstrations for `joybridge train --demos`",
    )
    add_page_options(play)
    add_overrides(play, "options and parameters of the game, e.g. options.level=6 parameters.bird_speed=0.5")
    options = parse_overrides(parser, arguments)
    if options.rate and len(options.rate) != options.players:
        play.error(f"--rate: got {len(options.rate)} names, expected one for each of {options.players} players")
    if len(set(options.rate)) < len(options.rate):
        play.error(f"--rate: got {' and '.join(options.rate)}, expected a name of its own for each player")
    if options.rate and options.players == 1 and not options.others:
        play.error("--rate needs others to play against; name them with --others")
    if options.against and options.players > 1:
        play.error("--against lets a policy play beside one person; leave it out, or --players")
    check_credentials(play, options, options.simulator)
    return options


def _check_seats(options: argparse.Namespace, game: str, seats: int) -> None:
    """Raise ConfigError if there is no seat for others, or not one for everybody, or if chance would be rated."""
    if options.players > seats:
        raise ConfigError(f"--players: got {options.players}, expected at most {seats}, the seats of {game}")
    if options.others and options.players == seats:
        whose = "you hold it" if seats == 1 else "people hold them"
        raise ConfigError(
            f"--others: {game} has {'one seat' if seats == 1 else f'{seats} seats'}, and {whose}; leave --others out"
        )
    if options.rate and not options.others and options.players < seats:
        raise ConfigError(f"--rate: {game} has {seats} seats, and chance would hold some; name others with --others")


def _what(options: argparse.Namespace, game: str, settings: "Settings") -> "tuple[PageGame, Settings]":
    """Return what pages play, and the settings to begin with. Raises ConfigError."""
    from joybridge.viewer.page_session import PageGame

    what = PageGame(game, options.timeout, options.players, demos=options.demos)
    against = [str(options.against)] if options.against else []
    given = {"--against": against, "--others": options.others, "--rate": options.rate}
    if not any(given.values()):
        return what, settings
    try:
        from joybridge.run.others import run_of
        from joybridge.viewer.run_opponent import load_others, open_rival, rate_people, run_settings
    except ModuleNotFoundError as error:
        used = " and ".join(argument for argument, names in given.items() if names)
        raise ConfigError(
            f"{used}: needs the module {error.name}; install it with `pip install 'joybridge[train]'`"
        ) from None
    for argument in ("--against", "--others"):
        for run in filter(None, map(run_of, given[argument])):
            settings = run_settings(argument, run, game, settings)
    what = replace(
        what,
        against=partial(open_rival, options.against) if against else None,
        others=partial(load_others, options.others, game) if options.others else None,
        rated=partial(rate_people, options.others, options.rate) if options.rate else None,
    )
    return what, settings
