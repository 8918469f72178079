"""Sessions: any number at once, each on its own, however it ends."""

from contextlib import ExitStack

from joybridge.conformance.registry import check, expect, expect_equal
from joybridge.conformance.subject import (
    ARENAS,
    FEW,
    Player,
    Recording,
    Subject,
    act_request,
    expect_same,
    reset_request,
)
from joybridge.conformance.wire import OK, Ended, Server, Stream
from joybridge.v1 import bridge_pb2 as pb

MANY_SESSIONS = 8


@check("SESSION")
def sessions_side_by_side_do_not_influence_each_other(subject: Subject) -> None:
    """Any number of sessions may run at once; they do not influence each other."""
    with Stream(subject.server) as one, Stream(subject.server) as other:
        player = Player(one, Recording(subject.spec, ARENAS), subject.start())
        disturber = Player(other, Recording(subject.spec, 1), subject.start(arenas=1, seed=9))
        for _ in range(FEW):
            player.decide()
            disturber.decide()
    expect_same(player.recording, subject.brief, "beside another session")


@check("SESSION")
def sessions_with_one_seed_do_not_influence_each_other(subject: Subject) -> None:
    """Any number of sessions may run at once; they do not influence each other, even where they play the same."""
    with Stream(subject.server) as one, Stream(subject.server) as other:
        players = [Player(s, Recording(subject.spec, ARENAS), subject.start()) for s in (one, other)]
        for _ in range(FEW):
            for player in players:
                player.decide()
    for player in players:
        expect_same(player.recording, subject.brief, "beside a session with the same seed")


@check("SESSION")
def many_sessions_can_be_open_at_once(subject: Subject) -> None:
    """Any number of sessions may run at once on one server."""
    with ExitStack() as stack:
        for index in range(MANY_SESSIONS):
            answer = stack.enter_context(Stream(subject.server)).ask(subject.start(seed=index))
            expect(not isinstance(answer, Ended), f"{answer} in session {index + 1}", "a session")


@check("SESSION")
def a_reset_in_one_session_is_none_in_another(subject: Subject) -> None:
    """Sessions do not influence each other."""
    with Stream(subject.server) as one, Stream(subject.server) as other:
        player = Player(one, Recording(subject.spec, ARENAS), subject.start())
        disturber = Player(other, Recording(subject.spec, ARENAS), subject.start())
        for _ in range(FEW):
            disturber.send(reset_request(5))
            player.decide()
    expect_same(player.recording, subject.brief, "beside a session that was reset")


@check("ERRORS")
def an_error_ends_its_own_session_and_no_other(subject: Subject) -> None:
    """Every error ends its session and no other."""
    with Stream(subject.server) as one:
        player = Player(one, Recording(subject.spec, ARENAS), subject.start())
        for _ in range(FEW):
            subject.play(subject.start(), pb.PlayRequest())
            player.decide()
    expect_same(player.recording, subject.brief, "beside sessions that failed")


@check("SESSION")
def a_stream_without_requests_ends_without_an_error(subject: Subject) -> None:
    """The stream is the session: closing it is no error, even before Start."""
    played = subject.play()
    expect_equal(played.end, OK, "the end")


@check("SESSION")
def a_client_that_closes_half_of_the_stream_is_let_go(subject: Subject) -> None:
    """Closing the stream frees the arenas: a server does not wait for more requests."""
    with Stream(subject.server) as stream:
        stream.ask(subject.start())
        came = stream.finish()
        expect(came == OK, came if isinstance(came, Ended) else "another response", OK)


@check("SESSION")
def a_session_that_is_cancelled_disturbs_no_other(subject: Subject) -> None:
    """Losing the stream frees its arenas and no others."""
    with Stream(subject.server) as one:
        player = Player(one, Recording(subject.spec, ARENAS), subject.start())
        for _ in range(FEW):
            with Stream(subject.server) as other:
                other.ask(subject.start(seed=9))
                other.requests.put(subject.brief.requests[1] if len(subject.brief.requests) > 1 else pb.PlayRequest())
                other.cancel()  # while the server is at work on it
            player.decide()
    expect_same(player.recording, subject.brief, "beside sessions that were cancelled")


@check("SESSION")
def a_client_that_goes_away_disturbs_no_other(subject: Subject) -> None:
    """Losing the stream frees its arenas and no others."""
    with Stream(subject.server) as one:
        player = Player(one, Recording(subject.spec, ARENAS), subject.start())
        for _ in range(3):
            with Server(subject.server.address, subject.server.seconds) as gone:
                lost = Stream(gone)
                lost.ask(subject.start(seed=9))
                gone.close()  # the connection, with the session still open
                lost.requests.put(None)
            player.decide()
        for _ in range(FEW - 3):
            player.decide()
    expect_same(player.recording, subject.brief, "beside clients that went away")


@check("DETERMINISM")
def another_connection_plays_the_same(subject: Subject) -> None:
    """The same bytes, whatever the session or the transport."""
    with Server(subject.server.address, subject.server.seconds) as other:
        expect_same(subject.record(server=other), subject.brief, "over another connection")


@check("DETERMINISM")
def requests_that_do_not_wait_for_responses_play_the_same(subject: Subject) -> None:
    """Requests are answered in order, whether or not the client waits for each response."""
    came = Recording(subject.spec, ARENAS, steps=subject.play(*subject.brief.requests).steps)
    expect_same(came, subject.brief, "with all requests sent at once")


@check("ERRORS")
def after_many_refusals_the_server_plays_as_before(subject: Subject) -> None:
    """Every error ends its session and no other, and none that is still to come."""
    for _ in range(MANY_SESSIONS):
        subject.play(act_request(pb.Act()))
        subject.play(subject.start(arenas=0))
        subject.play(subject.start(), act_request(pb.Act()))
    expect_same(subject.record(), subject.brief, "after refusals")
