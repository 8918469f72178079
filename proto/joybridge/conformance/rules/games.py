"""The list of games, and names that are not in it."""

from joybridge.conformance.expectations import expect
from joybridge.conformance.registry import check, table
from joybridge.conformance.spec_expectations import expect_unique_names
from joybridge.conformance.subject import NOT_FOUND, Subject
from joybridge.contract.limits import MAX_DESCRIPTION, MAX_NAME
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
    """The description of a game is one sentence, printable, of at most 1,000 characters."""
    for game in subject.client.list_games():
        expect(game.description.strip(), f"no description of {game.name!r}", "one sentence")
        short = game.description.isprintable() and len(game.description) <= MAX_DESCRIPTION
        expect(short, f"{game.description[:MAX_NAME]!r}… as the description of {game.name!r}", "one such sentence")


@check("ListGames", per_server=True)
def every_listed_game_has_a_spec(subject: Subject) -> None:
    """DescribeGame accepts every name that ListGames returns."""
    for game in subject.client.list_games():
        subject.client.describe(game.name)


UNKNOWN = "no_such_game"
NAMES = (  # name, section, rule, names
    (
        "unknown_game_is_not_found_by_describe",
        "ERRORS",
        "DescribeGame of an unknown game is NOT_FOUND.",
        (UNKNOWN, " "),
    ),
    ("empty_game_name_is_not_found_by_describe", "ERRORS", "DescribeGame without a name is NOT_FOUND.", ("",)),
)


@table(NAMES, per_server=True)
def _is_not_found_by_describe(subject: Subject, names: tuple[str, ...]) -> None:
    for name in names:
        subject.expect_no_spec(name, {}, NOT_FOUND, [name] if name else [])


@check("ERRORS", per_server=True)
def unknown_game_is_not_found_by_start(subject: Subject) -> None:
    """Start with an unknown game is NOT_FOUND."""
    start = pb.PlayRequest(start=pb.Start(game=UNKNOWN, arenas=1))
    subject.expect_refused(start, codes=[NOT_FOUND], words=[UNKNOWN])


@check("ERRORS", per_server=True)
def empty_game_name_is_not_found_by_start(subject: Subject) -> None:
    """Start without a name is NOT_FOUND."""
    subject.expect_refused(pb.PlayRequest(start=pb.Start(arenas=1)), codes=[NOT_FOUND], words=[])
