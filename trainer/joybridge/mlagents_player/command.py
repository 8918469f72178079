"""`joybridge mlagents`: a trainer of ML-Agents trains a game of Joybridge."""

import argparse
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager

from joybridge.client.client import Session, describe, wait_for
from joybridge.client.launch import simulator_process
from joybridge.client.own_games import choose_game
from joybridge.client.run_command import add_one_simulator, protected, run_command, search_here
from joybridge.config.game_settings import check_settings, read_settings
from joybridge.config.overrides import add_overrides, parse_overrides
from joybridge.contract.argument_types import PORTS, at_least, command_parser, seconds
from joybridge.contract.credentials import check_credentials
from joybridge.mlagents import communicator_pb2 as ml
from joybridge.mlagents.wire import PORT
from joybridge.mlagents_player.connection import connect, play
from joybridge.mlagents_player.player import Player
from joybridge.progress import say

WAIT = 10.0  # seconds for a simulator to answer


def main(arguments: Sequence[str] | None = None, prog: str = "joybridge") -> int:
    """Run the command line, the command first, and return its exit status."""
    return run_command(_play, _parse(arguments, prog))


def _play(options: argparse.Namespace) -> None:
    search_here()
    with ExitStack() as resources:
        settings = read_settings(options.overrides)
        name, place = resources.enter_context(_simulator(options))
        check_settings(*settings, describe(place, name, settings.options))

        def begin(trainer: ml.TrainerHello) -> Player:
            seed, arenas = trainer.seed % 2**32, options.arenas or max(1, trainer.num_areas)
            session = Session(place, name, arenas=arenas, seed=seed, **settings._asdict())
            return Player(resources.enter_context(session), seed, statistics=not options.no_statistics)

        exchange = resources.enter_context(connect(options.port, options.wait, say))
        steps = play(exchange, name, begin)
    say(f"the trainer has ended after {steps} steps of {name}")


@contextmanager
def _simulator(options: argparse.Namespace) -> Iterator[tuple[str, str]]:
    """Yield the name of the game and the address of a simulator, which is running or is started for it."""
    place = protected(options.simulator, options) if options.simulator else None
    name, places = choose_game(options.what, options.game, place)
    if place:
        wait_for(place, WAIT, say)
        yield name, place
        return
    with simulator_process(places) as started:
        yield name, started


def _parse(arguments: Sequence[str] | None, prog: str) -> argparse.Namespace:
    parser, player = command_parser(
        prog,
        "mlagents",
        "Play the part of a Unity player: a trainer of ML-Agents, such as mlagents-learn, trains the game.",
    )
    player.add_argument("what", metavar="GAME", help="a game, by its name or as MODULE:CLASS")
    add_one_simulator(player)
    player.add_argument(
        "--port",
        "--mlagents-port",
        type=at_least(1, PORTS),
        default=PORT,
        metavar="PORT",
        help="of the trainer, on this machine; default %(default)s, where mlagents-learn waits for an editor",
    )
    player.add_argument(
        "--arenas",
        type=at_least(1),
        metavar="N",
        help="copies of the game; default: what the trainer says, as num_areas",
    )
    player.add_argument(
        "--wait",
        type=seconds,
        default=60.0,
        metavar="SECONDS",
        help="how long to wait for the trainer; default %(default)g",
    )
    player.add_argument(
        "--no-statistics",
        action="store_true",
        help="send no metrics of episodes, about which a trainer warns that has no channel for statistics",
    )
    for ignored in ("-nographics", "-batchmode"):  # a trainer gives these to a player that it starts
        player.add_argument(ignored, action="store_true", help=argparse.SUPPRESS)
    player.add_argument("-logFile", "-logfile", help=argparse.SUPPRESS)
    add_overrides(player, "options and parameters of the game, e.g. options.level=6 parameters.bird_speed=0.5")
    options = parse_overrides(parser, arguments)
    check_credentials(player, options, options.simulator)
    return options
