"""`joybridge runs`: a table of the runs in a folder."""

import argparse
import json
from collections.abc import Sequence
from pathlib import Path

from joybridge.client.run_command import run_command
from joybridge.contract.argument_types import command_parser
from joybridge.play.text_table import aligned
from joybridge.run.results import table

WIDEST = 60  # characters of a cell


def main(arguments: Sequence[str] | None = None, prog: str = "joybridge") -> int:
    """Run the command line and return its exit status."""
    parser, runs = command_parser(prog, "runs", "List the runs in a folder.")
    runs.add_argument(
        "folder", type=Path, nargs="?", default=Path("runs"), help="folder of the runs; default %(default)s"
    )
    runs.add_argument("--json", action="store_true", help="print one JSON object per run instead")
    return run_command(_runs, parser.parse_args(arguments))


def _runs(options: argparse.Namespace) -> None:
    lines = table(options.folder)
    if options.json:
        print("\n".join(map(json.dumps, lines)))
        return
    columns = list(dict.fromkeys(column for line in lines for column in line))
    rows = [columns, *([_cut(line.get(column, "")) for column in columns] for line in lines)]
    print("\n".join(aligned(rows, numbers=False)))


def _cut(text: str) -> str:
    return text if len(text) <= WIDEST else f"{text[: WIDEST - 1]}…"
