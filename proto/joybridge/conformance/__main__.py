"""The command `joybridge check`."""

import argparse
import sys
from collections.abc import Sequence

from joybridge.conformance import runner
from joybridge.contract.address import address


def main(arguments: Sequence[str] | None = None, prog: str = "python -m joybridge.conformance") -> int:
    """Run the command line and return its exit status: 1 where the server breaks a rule."""
    parser = argparse.ArgumentParser(prog=prog)
    commands = parser.add_subparsers(dest="command", required=True)
    checker = commands.add_parser("check", help="test a server, in any language, on every rule of the contract")
    checker.add_argument("address", type=address, metavar="ADDRESS", help="HOST:PORT or unix:PATH of the server")
    checker.add_argument(
        "--game", action="append", default=[], metavar="NAME", help="only this game (may be repeated); default: all"
    )
    checker.add_argument(
        "--deadline", type=float, default=runner.DEADLINE, metavar="SECONDS",
        help="the longest that a call or a session of the checks may take; default %(default)s",
    )  # fmt: skip
    checker.add_argument("--json", action="store_true", help="print the results as one JSON object on the last line")
    checker.add_argument("--junit", metavar="FILE", help="also write the results as JUnit XML")
    options = parser.parse_args(arguments)
    try:
        return runner.main(options.address, options.game, options.deadline, options.json, options.junit)
    except OSError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2


if __name__ == "__main__":
    sys.exit(main())
