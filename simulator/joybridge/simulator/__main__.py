"""The simulator's commands: serve, list, new."""

import argparse
import asyncio
import logging
import sys
from collections.abc import Sequence
from pathlib import Path

from joybridge.contract.address import DEFAULT_ADDRESS, address
from joybridge.contract.errors import JoybridgeError
from joybridge.simulator.catalog import load_games
from joybridge.simulator.listing import listing
from joybridge.simulator.new_game.write import write_game
from joybridge.simulator.service import serve


def main(arguments: Sequence[str] | None = None, prog: str = "python -m joybridge.simulator") -> int:
    """Run a command and return its exit status: 2 for an error that the user can fix."""
    options = _parser(prog).parse_args(arguments)
    logging.basicConfig(level=logging.INFO, stream=sys.stderr, format="%(asctime)s %(name)s %(levelname)s %(message)s")
    try:
        if options.command == "new":
            print(write_game(options.name, options.folder))
            return 0
        if options.game:  # the script `joybridge`, unlike `python -m`, does not search the current folder
            sys.path.insert(0, str(Path.cwd()))
        games = load_games(options.game)
        if options.command == "list":
            print(listing(games))
        else:
            asyncio.run(serve(games, options.address, options.sessions, options.with_parent))
    except (JoybridgeError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    return 0


def _parser(prog: str) -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog=prog, description="Run games for trainers.")
    commands = parser.add_subparsers(dest="command", required=True)
    games = argparse.ArgumentParser(add_help=False)
    games.add_argument(
        "--game",
        action="append",
        default=[],
        metavar="MODULE:CLASS",
        help="add this game to the built-in and installed ones (repeatable); the current folder is searched first",
    )
    server = commands.add_parser("serve", parents=[games], help="serve games over gRPC until interrupted")
    server.add_argument(
        "--address",
        type=address,
        default=DEFAULT_ADDRESS,
        help="HOST:PORT (port 0: any free port) or unix:PATH; default %(default)s. Connections are neither encrypted "
        "nor authenticated: listen on other interfaces only in a trusted network",
    )
    server.add_argument(
        "--with-parent", action="store_true", help="exit when standard input closes, i.e. with the parent process"
    )
    server.add_argument(
        "--sessions", type=_sessions, default=64, help="maximum number of open sessions; default %(default)s"
    )
    commands.add_parser("list", parents=[games], help="list the games: options, parameters, sensors, actions, rewards")
    author = commands.add_parser("new", help="create a new game: a small complete one to start from")
    author.add_argument("name", help="name of the game and its files, for example my_game")
    author.add_argument("--folder", type=Path, default=Path(), metavar="DIR", help="where to write; default: here")
    return parser


def _sessions(text: str) -> int:
    """Return a number of sessions. Raises ArgumentTypeError."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"got {text!r}, expected a whole number, at least 1")
    return int(text)


if __name__ == "__main__":
    sys.exit(main())
