"""The command `joybridge doctor`."""

import argparse
import json
import sys
import time
from collections.abc import Sequence
from importlib import import_module

from joybridge.conformance.examination import Finding, Settings, examine
from joybridge.conformance.expectations import Violation
from joybridge.contract.address import DEFAULT_ADDRESS, address
from joybridge.contract.argument_types import command_parser
from joybridge.contract.credentials import add_credentials_arguments, load_credentials
from joybridge.contract.errors import JoybridgeError
from joybridge.contract.text import printable
from joybridge.process import leave
from joybridge.v1 import bridge_pb2 as pb

UNREACHED = ("port", "calls")  # without them nothing else can be examined
WORDS = {True: "ok", False: "problem", None: "not examined"}


def main(arguments: Sequence[str] | None = None, prog: str = "python -m joybridge.conformance.doctor") -> int:
    """Run the command line and return its exit status.

    The status is 0 if no problem is found, 1 if one is found, and 2 if nothing can be examined: no server answers, or
    the configuration cannot be read.
    """
    parser, doctor = command_parser(
        prog,
        "doctor",
        "Look at a running server for a few seconds, and say what is wrong and what to repair first.",
    )
    help_ = f"HOST:PORT or unix:PATH; default {DEFAULT_ADDRESS}, where `joybridge serve` listens by default"
    doctor.add_argument("address", nargs="?", metavar="ADDRESS", help=help_)
    help_ = "also examine whether the server fits this configuration"
    doctor.add_argument("config", nargs="?", metavar="CONFIG", help=help_)
    doctor.add_argument("overrides", nargs="*", metavar="key=value", help="keys of the configuration")
    help_ = "look at this game; default: that of CONFIG, or all games. May be repeated"
    doctor.add_argument("--game", action="append", default=[], metavar="NAME", help=help_)
    add_credentials_arguments(doctor)
    doctor.add_argument("--json", action="store_true", help="print the findings as one JSON object on the last line")
    options = _parse(doctor, parser.parse_args(arguments))
    begin = time.perf_counter()
    findings: list[Finding] = []

    def report(finding: Finding) -> None:
        findings.append(finding)
        print(printable(f"{WORDS[finding.ok]:<14}{finding.about:<10}{finding.text}"), flush=True)

    try:
        credentials = load_credentials(options.tls_ca, options.token_file)
        credentials.check(options.address)
        games, settings, missing = options.game, Settings(), ""
        if options.config:
            try:
                game, settings = _configured(options.config, options.overrides)
                games = games or [game]
            except ModuleNotFoundError as error:  # the trainer is not installed; the kit works without it
                missing = f"needs the module {error.name}; install it with `pip install 'joybridge[train]'`"
        for finding in examine(options.address, games, settings, credentials):
            report(finding)
        if missing:
            report(Finding("config", None, missing))
    except (JoybridgeError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130
    problems = [finding for finding in findings if finding.ok is False]
    seconds = time.perf_counter() - begin
    if problems:
        count = "1 problem" if len(problems) == 1 else f"{len(problems)} problems"
        print(f"\n{count} in {seconds:.1f} s; repair first: {problems[0].about}, then run this again")
    else:
        print(f"\nno problem found in {seconds:.1f} s; `joybridge check {options.address}` tests every rule")
    if options.json:
        entries = [{"about": finding.about, "ok": finding.ok, "text": finding.text} for finding in findings]
        print(json.dumps({"address": options.address, "problems": len(problems), "findings": entries}))
    return 2 if problems and problems[0].about in UNREACHED else int(bool(problems))


def _parse(doctor: argparse.ArgumentParser, options: argparse.Namespace) -> argparse.Namespace:
    """Give the options their address, if a configuration stands in its place. Ends with the usage for what is neither.

    A server is not started here: `doctor` is for those in any language, and needs nothing that one needs.
    """
    first = options.address
    if first is None:
        options.address = DEFAULT_ADDRESS
    elif ":" not in first:
        given = [first, *([options.config] if options.config else []), *options.overrides]
        options.address, (options.config, *options.overrides) = DEFAULT_ADDRESS, given
    else:
        try:
            address(first)
        except argparse.ArgumentTypeError as error:
            doctor.error(f"{error}; serve a game of your own first: `joybridge serve --game {first}`")
    return options


def _configured(config: str, overrides: Sequence[str]) -> tuple[str, Settings]:
    """Return the game of a configuration, and how it is played there.

    Raises JoybridgeError, and ModuleNotFoundError if the trainer is not installed.
    """
    trainer = import_module("joybridge.policy.config_fit")
    loaded = trainer.find_and_load(config, overrides)

    def check(spec: pb.GameSpec) -> str:
        if loaded.arenas > spec.max_arenas:
            raise Violation(f"arenas is {loaded.arenas}", f"{spec.max_arenas} at most")
        try:
            trainer.check_fit(loaded, spec)
        except JoybridgeError as error:
            raise Violation(str(error), "a configuration that fits the game") from error
        return f"{config} fits: {loaded.layout}, {loaded.arenas} arenas"

    fixed = {name: value for name, value in loaded.parameters.items() if isinstance(value, float)}
    return loaded.game, Settings(loaded.options, fixed, loaded.arenas, check)


if __name__ == "__main__":
    leave(main())
