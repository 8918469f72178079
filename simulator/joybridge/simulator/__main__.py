"""The simulator's command line: serve, list, new."""

import argparse
import asyncio
import logging
import sys
from collections.abc import Sequence
from pathlib import Path

from joybridge.contract.address import DEFAULT_ADDRESS, address
from joybridge.simulator.catalogue import CatalogueError, load_games
from joybridge.simulator.new import NewGameError, new_game
from joybridge.simulator.service import serve


def main(arguments: Sequence[str] | None = None, prog: str = "python -m joybridge.simulator") -> int:
    """Run the command line and return its exit status."""
    parser = argparse.ArgumentParser(prog=prog, description="Run games for trainers to play.")
    commands = parser.add_subparsers(dest="command", required=True)
    games = argparse.ArgumentParser(add_help=False)
    games.add_argument(
        "--game",
        action="append",
        default=[],
        metavar="MODULE:CLASS",
        help="serve this game, too (may be repeated); its module is looked for in the current folder first. Built-in "
        "and installed games are always there",
    )
    server = commands.add_parser("serve", parents=[games], help="serve games over gRPC until interrupted")
    server.add_argument(
        "--address",
        type=address,
        default=DEFAULT_ADDRESS,
        help="HOST:PORT (port 0: any free one) or unix:PATH; default %(default)s. There is no encryption and no "
        "password: listen beyond this machine only in a network you trust",
    )
    server.add_argument(
        "--with-parent",
        action="store_true",
        help="end when standard input closes: with the process that started this one",
    )
    server.add_argument("--sessions", type=_sessions, default=64, help="the most sessions at once; default %(default)s")
    commands.add_parser("list", parents=[games], help="list the games with their options")
    author = commands.add_parser("new", help="begin a game of your own: write a small one that plays and trains")
    author.add_argument("name", help="of the game and its files, as in my_game")
    author.add_argument("--folder", type=Path, default=Path(), metavar="DIR", help="where to write; default: here")
    options = parser.parse_args(arguments)

    logging.basicConfig(level=logging.INFO, stream=sys.stderr, format="%(asctime)s %(name)s %(levelname)s %(message)s")
    try:
        if options.command == "new":
            print(new_game(options.name, options.folder))
            return 0
        catalogue = load_games(options.game)
        if options.command == "list":
            for game in catalogue.values():
                print(f"{game.name}: {game.description}")
                for option in game.options():
                    print(f"  {option.name} = {' | '.join(option.choices)}  (default {option.default_choice})")
        else:
            asyncio.run(serve(catalogue, options.address, options.sessions, options.with_parent))
    except (CatalogueError, NewGameError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    return 0


def _sessions(text: str) -> int:
    """Return a number of sessions. Raises ArgumentTypeError."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"got {text!r}, expected a whole number, at least 1")
    return int(text)


if __name__ == "__main__":
    sys.exit(main())
