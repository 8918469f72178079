"""The simulator's command line: serve, list, check, new."""

import argparse
import asyncio
import logging
import sys
from pathlib import Path

from simulator import check
from simulator.catalogue import CatalogueError, load_games
from simulator.new import NewGameError, new_game
from simulator.service import serve

DEFAULT_ADDRESS = "127.0.0.1:5005"
HIGHEST_PORT = 65535


def main(arguments: list[str] | None = None) -> int:
    """Run the command line and return its exit status."""
    parser = argparse.ArgumentParser(prog="python -m simulator", description="Run games for trainers to play.")
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
        type=_address,
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
    checker = commands.add_parser("check", help="try a server, in any language, on every rule of the contract")
    checker.add_argument("address", type=_address, metavar="ADDRESS", help="HOST:PORT or unix:PATH of the server")
    checker.add_argument(
        "--game", action="append", default=[], metavar="NAME", help="only this game (may be repeated); else all"
    )
    checker.add_argument(
        "--deadline", type=float, default=check.DEADLINE, metavar="SECONDS",
        help="the longest that a call or a session of the checks may take; default %(default)s",
    )  # fmt: skip
    checker.add_argument("--json", action="store_true", help="print the results as one JSON object on the last line")
    checker.add_argument("--junit", metavar="FILE", help="write the results as JUnit XML, too")
    author = commands.add_parser("new", help="begin a game of your own: write a small one that plays and trains")
    author.add_argument("name", help="of the game and its files, as in my_game")
    author.add_argument("--folder", type=Path, default=Path(), metavar="DIR", help="where to write; default: here")
    options = parser.parse_args(arguments)

    logging.basicConfig(level=logging.INFO, stream=sys.stderr, format="%(asctime)s %(name)s %(levelname)s %(message)s")
    try:
        if options.command == "check":
            return check.main(options.address, options.game, options.deadline, options.json, options.junit)
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


def _address(text: str) -> str:
    """Return an address whose port can be one, as it came. Raises ArgumentTypeError."""
    host, _, port = text.rpartition(":")
    if text.startswith("unix:") or (host and port.isdecimal() and int(port) <= HIGHEST_PORT):
        return text
    wanted = f"HOST:PORT with a port from 0 to {HIGHEST_PORT}, as in {DEFAULT_ADDRESS}, or unix:PATH"
    raise argparse.ArgumentTypeError(f"got {text!r}, expected {wanted}")


def _sessions(text: str) -> int:
    """Return a number of sessions. Raises ArgumentTypeError."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"got {text!r}, expected a whole number, at least 1")
    return int(text)


if __name__ == "__main__":
    sys.exit(main())
