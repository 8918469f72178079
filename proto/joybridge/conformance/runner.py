"""Try a server on the contract: `joybridge check ADDRESS`. The rules are in `joybridge.conformance.rules`."""

import json
import sys
import time
from collections.abc import Iterator, Sequence

from joybridge.conformance.registry import Broken, Check, DoesNotApply, Silent
from joybridge.conformance.report import FAILED, NO_MATTER, PASSED, Result, as_json, summary, write_junit
from joybridge.conformance.rules import CHECKS
from joybridge.conformance.subject import Subject
from joybridge.conformance.wire import Server

DEADLINE = 10.0  # seconds of a call; a session, too, is one
PATIENCE = 3  # deadlines that a game may let pass before the rest of its checks is given up


def run_checks(
    address: str, games: Sequence[str] = (), seconds: float = DEADLINE, checks: Sequence[Check] = tuple(CHECKS)
) -> Iterator[Result]:
    """Yield what comes of the checks of a server as a whole and of each of its games, or of the named ones.

    No call takes longer than `seconds`. A server that lets several deadlines pass is not asked any further.
    """
    with Server(address, seconds) as server:
        whole = _Patient(Subject(server, ""), "server")
        yield from whole.results([check for check in checks if check.once])
        if not games:
            try:
                games = [game.name for game in server.list_games()]
            except Broken:
                return  # a check of the server as a whole has said so
        for game in games:
            subject = _Patient(Subject(server, game), game)
            yield from subject.results([check for check in checks if not check.once])


class _Patient:
    """One game, whose checks are given up when it has let too many deadlines pass."""

    def __init__(self, subject: Subject, name: str) -> None:
        self.subject, self.name = subject, name
        self.silences = 0

    def results(self, checks: Sequence[Check]) -> Iterator[Result]:
        for one in checks:
            if self.silences == PATIENCE:
                came = f"not tried: {PATIENCE} checks before it waited for an answer in vain"
                yield Result(self.name, one, FAILED, 0.0, came, "a server that answers")
            else:
                yield self.result(one)

    def result(self, one: Check) -> Result:
        begin = time.perf_counter()
        outcome, came, expected = PASSED, "", ""
        try:
            one.run(self.subject)
        except DoesNotApply as reason:
            outcome, came = NO_MATTER, str(reason)
        except Broken as broken:
            outcome, came, expected = FAILED, broken.came, broken.expected
            self.silences += isinstance(broken, Silent)
        except Exception as error:  # what the kit trips over has come from the server
            outcome, came, expected = FAILED, f"{type(error).__name__}: {error}", "nothing that stops the check"
        return Result(self.name, one, outcome, time.perf_counter() - begin, came, expected)


def main(address: str, games: Sequence[str], seconds: float, as_object: bool, junit: str | None) -> int:
    """Check a server, print what came of it, and return 0 if it keeps the contract and 1 if not."""
    results = []
    begin = time.perf_counter()
    for result in run_checks(address, games, seconds):
        print(*result.lines, sep="\n", flush=True)
        results.append(result)
    print(f"\n{summary(results)} in {time.perf_counter() - begin:.1f} s")
    if junit is not None:
        write_junit(junit, results)
    if as_object:
        print(json.dumps(as_json(address, results)))
    sys.stdout.flush()
    return int(any(result.outcome == FAILED for result in results))
