"""The simulator's command line: serve, list, check."""

import argparse
import asyncio
import logging
import sys

from simulator import check
from simulator.catalogue import CatalogueError, load_games
from simulator.service import serve

DEFAULT_ADDRESS = "127.0.0.1:5005"


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
        help="serve this game, too (may be repeated); built-in and installed games are always there",
    )
    server = commands.add_parser("serve", parents=[games], help="serve games over gRPC until interrupted")
    server.add_argument(
        "--address",
        default=DEFAULT_ADDRESS,
        help="HOST:PORT (port 0: any free one) or unix:PATH; default %(default)s. There is no encryption and no "
        "password: listen beyond this machine only in a network you trust",
    )
    server.add_argument(
        "--with-parent",
        action="store_true",
        help="end when standard input closes: with the process that started this one",
    )
    server.add_argument("--sessions", type=int, default=64, help="the most sessions at once; default %(default)s")
    commands.add_parser("list", parents=[games], help="list the games with their options")
    checker = commands.add_parser("check", help="try a server, in any language, on every rule of the contract")
    checker.add_argument("address", metavar="ADDRESS", help="HOST:PORT or unix:PATH of the server")
    checker.add_argument(
        "--game", action="append", default=[], metavar="NAME", help="only this game (may be repeated); else all"
    )
    checker.add_argument(
        "--deadline", type=float, default=check.DEADLINE, metavar="SECONDS",
        help="the longest that a call or a session of the checks may take; default %(default)s",
    )  # fmt: skip
    checker.add_argument("--json", action="store_true", help="print the results as one JSON object on the last line")
    checker.add_argument("--junit", metavar="FILE", help="write the results as JUnit XML, too")
    options = parser.parse_args(arguments)

    logging.basicConfig(level=logging.INFO, stream=sys.stderr, format="%(asctime)s %(name)s %(levelname)s %(message)s")
    try:
        if options.command == "check":
            return check.main(options.address, options.game, options.deadline, options.json, options.junit)
        catalogue = load_games(options.game)
        if options.command == "list":
            for game in catalogue.values():
                print(f"{game.name}: {game.description}")
                for option in game.options():
                    print(f"  {option.name} = {' | '.join(option.choices)}  (default {option.default_choice})")
        else:
            asyncio.run(serve(catalogue, options.address, options.sessions, options.with_parent))
    except (CatalogueError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
