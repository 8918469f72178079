"""Faults on purpose, one kind after the other; `--help` lists them.

python -m tools.chaos                           each kind, some faults, in about ten minutes
python -m tools.chaos messages --faults 10000   one kind, more often
python -m tools.chaos --short                   what CI runs, in about a minute

One line per kind tells the number of faults, what was not as it should be, and what was measured. The exit status is 1
if anything was not as it should be. It runs on Linux.
"""

import argparse
import os
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from tools.chaos.bombs import bombs
from tools.chaos.checkpoints import damages, saves
from tools.chaos.crowds import crowds
from tools.chaos.disks import disks
from tools.chaos.folders import folders
from tools.chaos.hangs import hangs
from tools.chaos.interrupts import interrupts
from tools.chaos.messages import messages
from tools.chaos.outcome import Outcome
from tools.chaos.pairs import pairs
from tools.chaos.policies import policies
from tools.chaos.programs import programs
from tools.chaos.servers import servers
from tools.chaos.several import several
from tools.chaos.training import connections, freezes, simulators, stops, trainers


class Kind(NamedTuple):
    """A kind of fault: what does it, how often by default, and how often in the short form."""

    function: Callable[[Path, int], Outcome]
    faults: int
    short: int = 0


KINDS = {
    "saves": Kind(saves, 200, 50),
    "damages": Kind(damages, 1000, 200),
    "folders": Kind(folders, 1, 1),
    "servers": Kind(servers, 1, 1),
    "policies": Kind(policies, 200, 10),
    "programs": Kind(programs, 20, 4),
    "several": Kind(several, 40, 3),
    "bombs": Kind(bombs, 1, 1),
    "messages": Kind(messages, 2000, 300),
    "crowds": Kind(crowds, 2000, 400),
    "hangs": Kind(hangs, 100, 50),
    "pairs": Kind(pairs, 5, 1),
    "disks": Kind(disks, 1),
    "interrupts": Kind(interrupts, 6),
    "simulators": Kind(simulators, 5, 1),
    "stops": Kind(stops, 5),
    "trainers": Kind(trainers, 5),
    "freezes": Kind(freezes, 5),
    "connections": Kind(connections, 5),
}


def main() -> int:
    """Run the command line and return its exit status."""
    about = "\n".join(f"  {name:<13}{kind.function.__doc__}" for name, kind in KINDS.items())
    parser = argparse.ArgumentParser(
        prog="python -m tools.chaos",
        description=(__doc__ or "").partition("\n")[0],
        epilog=f"kinds:\n{about}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("kinds", nargs="*", help="which to do; default all")
    parser.add_argument("--faults", type=int, help="how many of each kind; by default each has its own number")
    parser.add_argument("--short", action="store_true", help="few faults, and only of kinds that take seconds")
    options = parser.parse_args()
    if unknown := set(options.kinds) - set(KINDS):
        parser.error(f"unknown: {', '.join(sorted(unknown))}; expected any of {', '.join(KINDS)}")
    os.environ.setdefault("GRPC_VERBOSITY", "NONE")  # its own log tells of every connection that is cut
    wrong = False
    for name in options.kinds or KINDS:
        kind = KINDS[name]
        faults = options.faults or (kind.short if options.short else kind.faults)
        if not faults:
            continue
        begin = time.monotonic()
        with tempfile.TemporaryDirectory() as folder:
            outcome = kind.function(Path(folder), faults)
        wrong |= bool(outcome.problems)
        state = f"{len(outcome.problems)} PROBLEMS" if outcome.problems else "no problem"
        seconds = time.monotonic() - begin
        print(f"{name}: {outcome.faults:,} faults, {state}; {outcome.figures}; {seconds:.0f} s", flush=True)
        for problem in outcome.problems[:5]:
            print(f"  {problem}")
    return int(wrong)


if __name__ == "__main__":
    sys.exit(main())
