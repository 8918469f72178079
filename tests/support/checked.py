"""Checks of the kit, made up or run."""

import json

from joybridge.conformance.__main__ import main
from joybridge.conformance.registry import Check


def made_up(run):
    return Check("rule_holds", "order", "A rule.", "Act", False, run)


def run(capsys, *arguments):
    """Run the command line; return the exit status, the JSON object and the lines before it."""
    status = main(["check", *arguments, "--json"])
    *lines, last = capsys.readouterr().out.splitlines()
    return status, json.loads(last), lines
