"""The list of games, and names that are not in it."""

from joybridge.conformance.client import Status
from joybridge.conformance.expectations import Violation, expect
from joybridge.conformance.names import expect_unique_names
from joybridge.conformance.registry import check
from joybridge.conformance.subject import NOT_FOUND, Subject, expect_error
from joybridge.v1 import bridge_pb2 as pb


@check("ListGames", per_server=True)
def list_of_games_is_not_empty(subject: Subject) -> None:
    """ListGames returns the games that this server runs."""
    expect(subject.client.list_games(), "an empty list", "at least one game")


@check("GameSummary", per_server=True)
def game_names_are_unique(subject: Subject) -> None:
    """A name identifies one game in DescribeGame and Start."""
    expect_unique_names(subject.client.list_games(), "games")


@check("GameSummary", per_server=True)
def every_game_has_a_description(subject: Subject) -> None:
    """The description of a game is one sentence."""
    for game in subject.client.list_games():
        expect(game.description.strip(), f"no description of {game.name!r}", "one sentence")


@check("ListGames", per_server=True)
def every_listed_game_has_a_spec(subject: Subject) -> None:
    """DescribeGame accepts every name that ListGames returns."""
    for game in subject.client.list_games():
        subject.client.describe(game.name)


@check("ERRORS", per_server=True)
def unknown_game_is_not_found_by_describe(subject: Subject) -> None:
    """DescribeGame of an unknown game is NOT_FOUND."""
    for name in ("no_such_game", " "):
        _expect_no_spec(subject, name, [name])


@check("ERRORS", per_server=True)
def empty_game_name_is_not_found_by_describe(subject: Subject) -> None:
    """DescribeGame without a name is NOT_FOUND."""
    answer = subject.client.try_describe("", {})
    got = answer if isinstance(answer, Status) else "a spec"
    expect(isinstance(answer, Status) and answer.code == NOT_FOUND, got, "NOT_FOUND")


@check("ERRORS", per_server=True)
def unknown_game_is_not_found_by_start(subject: Subject) -> None:
    """Start with an unknown game is NOT_FOUND."""
    start = pb.PlayRequest(start=pb.Start(game="no_such_game", arenas=1))
    subject.expect_refused(start, codes=[NOT_FOUND], words=["no_such_game"])


@check("ERRORS", per_server=True)
def empty_game_name_is_not_found_by_start(subject: Subject) -> None:
    """Start without a name is NOT_FOUND."""
    subject.expect_refused(pb.PlayRequest(start=pb.Start(arenas=1)), codes=[NOT_FOUND], words=[])


def _expect_no_spec(subject: Subject, name: str, words: list[str]) -> None:
    answer = subject.client.try_describe(name, {})
    if not isinstance(answer, Status):
        raise Violation(f"a spec of {name!r}", "NOT_FOUND")
    expect_error(answer, [NOT_FOUND], words)
