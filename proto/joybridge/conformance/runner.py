"""Run checks against a server and yield their results."""

import time
from collections.abc import Iterable, Iterator, Sequence

import grpc

from joybridge.conformance.client import OPEN, Client, Status, Stream, Transport
from joybridge.conformance.expectations import NotApplicable, Suspicion, TimedOut, Unreachable, Violation
from joybridge.conformance.recording import Player, Recording
from joybridge.conformance.registry import Check
from joybridge.conformance.report import FAILED, NOT_APPLICABLE, PASSED, WARNING, Result
from joybridge.conformance.rules import CHECKS
from joybridge.conformance.rules.sessions import ended_sessions_are_freed
from joybridge.conformance.selection import require_known
from joybridge.conformance.subject import Subject
from joybridge.contract.credentials import Credentials
from joybridge.contract.text import printable
from joybridge.progress import say

DEADLINE = 30.0  # seconds until a response
PATIENCE = 4  # times the deadline: until a response in the first session of a game, which may compile it
MAX_TIMEOUTS = 3  # of one game; its other checks then fail without being run
FULL = "RESOURCE_EXHAUSTED"  # in what came, of a check that expects another status
SERVER = "server"  # the name in the results for checks of the whole server


def run_checks(
    address: str,
    games: Sequence[str] = (),
    seconds: float = DEADLINE,
    checks: Sequence[Check] = tuple(CHECKS),
    credentials: Credentials = OPEN,
    transport: Transport = "grpc",
) -> Iterator[Result]:
    """Yield the results of the checks of the whole server, then of those of each game.

    games: the games to check, by default all. seconds: the longest wait for a response. After MAX_TIMEOUTS timeouts
    the other checks of a game fail without being run. transport: of the messages of sessions. Raises
    Unreachable if no server responds or offers the transport, and SelectionError if the server does not have one of the
    games.
    """
    of_server = [check for check in checks if check.per_server]
    of_game = [check for check in checks if not check.per_server]
    with Client(address, seconds, credentials, transport) as client:
        listed = _listed_games(client)
        if not isinstance(listed, Status):
            require_known(games, listed, "game")
            if not games and len(listed) > 1:
                names = printable(", ".join(listed))
                say(f"checks {len(listed)} games, one after the other; --game NAME checks one: {names}")
            games = games or listed
        if not games and not of_server:
            got = f"ListGames failed with {listed}" if isinstance(listed, Status) else "ListGames returns no games"
            raise Unreachable(f"{address} has no game to check: {got}")
        for game in games if of_game else games[:1]:
            _warm_up(Client(address, PATIENCE * seconds, credentials, transport), game)
        yield from _results(Subject(client, games[0] if games else ""), SERVER, of_server)
        for game in games:
            yield from _results(Subject(client, game), game, of_game)


def _warm_up(client: Client, game: str) -> None:
    """Play a decision of a game. What goes wrong here is for the checks to find."""
    with client:
        try:
            subject = Subject(client, game)
            with Stream(client) as stream:
                Player(stream, Recording(subject.spec, 1), subject.start(arenas=1)).decide()
        except Unreachable:
            raise
        except Exception:  # whatever a broken server causes
            return


def _listed_games(client: Client) -> list[str] | Status:
    """Return the names of the games, or the status of a failed call, which the checks will report."""
    try:
        answer = client.try_list_games()
    except TimedOut as error:
        raise Unreachable(f"the server at {client.address} did not respond within {client.seconds:g} s") from error
    if not isinstance(answer, Status):
        return [game.name for game in answer]
    if answer.code == grpc.StatusCode.UNAVAILABLE:
        reason = printable(" ".join(answer.details.split()))
        raise Unreachable(
            f"no server responds at {client.address} ({reason}); start one, correct the address, or pass --tls-ca "
            "if it uses TLS"
        )
    if answer.code == grpc.StatusCode.UNAUTHENTICATED:
        raise Unreachable(f"the server at {client.address} wants another token, or one at all; see --token-file")
    return answer


def _results(subject: Subject, name: str, checks: Iterable[Check]) -> Iterator[Result]:
    timeouts = 0
    for check in checks:
        begin = time.perf_counter()
        outcome, got, expected, follows = PASSED, "", "", timeouts == MAX_TIMEOUTS
        try:
            if timeouts == MAX_TIMEOUTS:
                raise Violation(f"not run after {MAX_TIMEOUTS} timeouts", "responses within the deadline")
            check.run(subject)
        except NotApplicable as reason:
            outcome, got = NOT_APPLICABLE, str(reason)
        except Violation as violation:
            outcome, got, expected = FAILED, violation.got, violation.expected
            timeouts += isinstance(violation, TimedOut)
            if FULL in got and FULL not in expected and check.name != ended_sessions_are_freed.__name__:
                expected += " (the server is full: do sessions that were closed or lost still count?)"
                follows = True
        except Suspicion as suspicion:
            outcome, got, expected = WARNING, suspicion.got, suspicion.expected
        except Exception as error:  # the server sent something that the check does not expect at all
            outcome, got, expected = FAILED, f"{type(error).__name__}: {error}", "a response that the check can read"
        yield Result(name, check, outcome, time.perf_counter() - begin, got, expected, follows)
