"""Limits: more than a server accepts is refused, and it lives on."""

import grpc

from joybridge.conformance.registry import check, expect
from joybridge.conformance.subject import EXHAUSTED, INVALID, NOT_FOUND, Subject, expect_refusal
from joybridge.conformance.wire import OK, SERVICE, Ended
from joybridge.v1 import bridge_pb2 as pb

OVERSIZED = 8 * 2**20  # bytes: twice what gRPC itself accepts unless told otherwise
LONG = 100_000  # characters of a name


@check("Start")
def no_arenas_are_refused(subject: Subject) -> None:
    """A session has 1 or more arenas."""
    subject.refused(subject.start(0), words=["arenas"])


@check("ERRORS")
def more_arenas_than_the_spec_allows_are_refused(subject: Subject) -> None:
    """More arenas than this server accepts are RESOURCE_EXHAUSTED."""
    subject.refused(subject.start(subject.spec.max_arenas + 1), codes=[EXHAUSTED], words=["arenas"])


@check("ERRORS")
def very_many_arenas_are_refused(subject: Subject) -> None:
    """More arenas than this server accepts are RESOURCE_EXHAUSTED, and nothing is made for them before."""
    subject.refused(subject.start(2**32 - 1), codes=[EXHAUSTED], words=["arenas"])


@check("ERRORS", once=True)
def an_oversized_message_is_refused(subject: Subject) -> None:
    """More bytes than this server accepts are RESOURCE_EXHAUSTED."""
    played = subject.play(pb.PlayRequest(start=pb.Start(game="x" * OVERSIZED, arenas=1)))
    # A server that does accept so much still has no game of that name.
    expect_refusal(played.end, [EXHAUSTED, NOT_FOUND], [])


@check("ERRORS", once=True)
def a_very_long_name_is_refused_as_any_other(subject: Subject) -> None:
    """NOT_FOUND is for names of no game; a sentence that travels in a gRPC status has to be short."""
    played = subject.play(pb.PlayRequest(start=pb.Start(game="x" * LONG, arenas=1)))
    expect_refusal(played.end, [NOT_FOUND, EXHAUSTED], [])  # a server may take fewer bytes than this


@check("ERRORS", once=True)
def bytes_that_are_no_message_are_refused(subject: Subject) -> None:
    """The content of a message is wrong."""
    for data in (b"\xff", b"\x0a\x7f", b"\x0a\x03\x0a\x01\xff"):
        played = subject.play(data)
        # gRPC's own decoding refuses in most languages, with a status of its own.
        refused = played.end.code not in (OK.code, grpc.StatusCode.UNAVAILABLE) and not played.responses
        expect(refused, played.end, "an error of this session")


@check("ERRORS", once=True)
def a_server_lives_on_after_what_it_refused(subject: Subject) -> None:
    """Every error ends its session and no other."""
    for request in (b"\xff", pb.PlayRequest(start=pb.Start(game="x" * OVERSIZED, arenas=1))):
        subject.play(request)
        subject.server.list_games()


@check("NOT_FOUND", once=True)
def describing_an_unknown_game_is_not_found(subject: Subject) -> None:
    """DescribeGame answers NOT_FOUND for an unknown game."""
    for name in ("no_such_game", " "):
        answer = subject.server.try_describe(name, {})
        expect(isinstance(answer, Ended), "a spec", "NOT_FOUND")
        assert isinstance(answer, Ended)
        expect_refusal(answer, [NOT_FOUND], [name])


@check("NOT_FOUND", once=True)
def describing_no_game_is_not_found(subject: Subject) -> None:
    """A game has a name; the empty one stands for none."""
    answer = subject.server.try_describe("", {})
    expect(isinstance(answer, Ended) and answer.code == NOT_FOUND, "a spec or another error", "NOT_FOUND")


@check("ERRORS", once=True)
def starting_an_unknown_game_is_not_found(subject: Subject) -> None:
    """NOT_FOUND: no game of that name."""
    start = pb.PlayRequest(start=pb.Start(game="no_such_game", arenas=1))
    subject.refused(start, codes=[NOT_FOUND], words=["no_such_game"])


@check("ERRORS", once=True)
def starting_no_game_is_not_found(subject: Subject) -> None:
    """NOT_FOUND: no game of that name."""
    subject.refused(pb.PlayRequest(start=pb.Start(arenas=1)), codes=[NOT_FOUND], words=[])


@check("CHANGES", once=True)
def an_unknown_field_of_a_description_is_refused(subject: Subject) -> None:
    """A server ignores what it does not know only where this file says so."""
    name = subject.server.list_games()[0].name
    request = pb.DescribeGameRequest(game=name).SerializeToString() + b"\xf8\x07\x01"
    answer = subject.server.call(f"/{SERVICE}/DescribeGame", request, pb.DescribeGameResponse)
    expect(isinstance(answer, Ended), "a spec", "a refusal with INVALID_ARGUMENT")
    expect_refusal(answer, [INVALID], [])
