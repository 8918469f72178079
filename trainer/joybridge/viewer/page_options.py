"""The options of the page that both commands have. Needs no further package."""

import argparse

from joybridge.contract.argument_types import PORTS, at_least


def add_page_options(parser: argparse.ArgumentParser) -> None:
    """Add the options --port and --no-browser."""
    parser.add_argument(
        "--port",
        type=at_least(0, PORTS),
        metavar="PORT",
        help="of the page on this machine, 0: any free one; default 5006, or any free one where that is in use",
    )
    parser.add_argument("--no-browser", action="store_true", help="only print the URL of the page")
