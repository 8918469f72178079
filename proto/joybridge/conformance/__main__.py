"""The command `joybridge check`."""

import argparse
import json
import sys
import time
from collections.abc import Sequence

from joybridge.conformance.client import wait_for_server
from joybridge.conformance.registry import Check
from joybridge.conformance.report import FAILED, WARNING, Result, as_json, listing, repair_first, summary, write_junit
from joybridge.conformance.rules import FAMILIES
from joybridge.conformance.runner import DEADLINE, run_checks
from joybridge.conformance.selection import select
from joybridge.contract.address import address
from joybridge.contract.argument_types import command_parser, seconds
from joybridge.contract.credentials import add_credentials_arguments, load_credentials
from joybridge.contract.errors import JoybridgeError
from joybridge.process import leave
from joybridge.progress import Progress


def main(arguments: Sequence[str] | None = None, prog: str = "python -m joybridge.conformance") -> int:
    """Run the command line and return its exit status.

    The status is 0 if no check fails, 1 if a check fails, and 2 if nothing can be checked: an unknown name, a server
    that does not respond, a file that cannot be written.
    """
    parser, checker = command_parser(
        prog, "check", "Test a running server against the contract, in whatever language it is written."
    )
    checker.add_argument("address", nargs="?", metavar="ADDRESS", help="HOST:PORT or unix:PATH")
    for option, metavar, text in (
        ("--game", "NAME", "check this game; default: all games"),
        ("--family", "FAMILY", "run the checks of this family; default: all checks"),
        ("--only", "CHECK", "run this check, in addition to those of --family"),
    ):
        help_ = f"{text}. May be repeated"
        checker.add_argument(option, action="append", default=[], metavar=metavar, help=help_)
    checker.add_argument("--list", action="store_true", help="list the families, checks and rules, and exit")
    help_ = "the longest wait for a response. Default: %(default)g"
    checker.add_argument("--deadline", type=seconds, default=DEADLINE, metavar="SECONDS", help=help_)
    help_ = "how long to wait for a server that does not answer yet. Default: not at all"
    checker.add_argument("--wait", type=seconds, metavar="SECONDS", help=help_)
    help_ = "local: the messages of sessions go over a Unix socket, if the server offers it. Default: %(default)s"
    checker.add_argument("--transport", choices=["grpc", "local"], default="grpc", help=help_)
    add_credentials_arguments(checker)
    checker.add_argument("--quiet", action="store_true", help="print failures, warnings and the summary only")
    checker.add_argument("--json", action="store_true", help="print the results as one JSON object on the last line")
    checker.add_argument("--junit", metavar="FILE", help="write the results as JUnit XML")
    options = parser.parse_args(arguments)
    if not (options.address or options.list):
        checker.error("ADDRESS is missing; only --list needs none")
    try:
        options.address = address(options.address) if options.address else None
    except argparse.ArgumentTypeError as error:
        serve = (
            "; it is a running server that is tested: start one by `joybridge serve`, with --game MODULE:CLASS, "
            "--pygame PROGRAM or --gym ID for a game of your own"
        )
        checker.error(f"argument ADDRESS: {error}{'' if options.address[-1:].isdigit() else serve}")
    try:
        checks = select(options.family, options.only)
        if options.list:
            print(*listing(checks, FAMILIES), sep="\n")
            return 0
        return _check(checks, options)
    except (JoybridgeError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130


def _check(checks: Sequence[Check], options: argparse.Namespace) -> int:
    """Run the checks, print and write their results, and return the exit status."""
    begin = time.perf_counter()
    results: list[Result] = []
    progress = Progress()
    credentials = load_credentials(options.tls_ca, options.token_file)
    if options.wait:
        wait_for_server(options.address, options.wait, credentials)
    for result in run_checks(options.address, options.game, options.deadline, checks, credentials, options.transport):
        results.append(result)
        if result.outcome in (FAILED, WARNING) or not options.quiet:
            print(*result.lines, sep="\n", flush=True)
        else:
            progress.report(f"{len(results)} checks are done")
    print(f"\n{summary(results)} in {time.perf_counter() - begin:.1f} s")
    if sum(result.outcome == FAILED for result in results) > 1:
        names = ", ".join(repair_first(results, list(FAMILIES)))
        print(f"repair first: {names}. Other failures may follow from it; then run the kit again")
    if options.junit is not None:
        write_junit(options.junit, results)
    if options.json:
        print(json.dumps(as_json(options.address, results, list(FAMILIES))))
    sys.stdout.flush()
    return int(any(result.outcome == FAILED for result in results))


if __name__ == "__main__":
    leave(main())
