"""Sessions: several run at once, are independent of each other, and end with their stream."""

import time
from contextlib import ExitStack

from joybridge.conformance.client import OK, Client, Status, Stream
from joybridge.conformance.expectations import Violation, expect, expect_equal, skip_unless
from joybridge.conformance.recording import (
    Player,
    Recording,
    act_request,
    expect_same_recording,
    reset_request,
)
from joybridge.conformance.registry import check
from joybridge.conformance.subject import RESOURCE_EXHAUSTED, SHORT, Subject
from joybridge.v1 import bridge_pb2 as pb

MANY_SESSIONS = 8
ABANDONED = 72  # sessions that end in each way: more than servers accept at once by default
ROOM_SECONDS = 5.0  # a server notices the end of a session soon, not at once


@check("SESSION", per_server=True)
def ended_sessions_are_freed(subject: Subject) -> None:
    """When the client closes or loses a stream, the server frees the arenas: ended sessions do not count any more."""
    skip_unless(subject.game, "ListGames returns no games")
    start = subject.start(arenas=1)
    for way in ("cancelled", "lost with their connection", "refused a request"):
        for _ in range(ABANDONED // MANY_SESSIONS):
            _abandon(subject.client, start, way)
        _expect_room(subject.client, start, f"{ABANDONED} sessions were {way}")


@check("SESSION")
def parallel_sessions_are_independent(subject: Subject) -> None:
    """Any number of sessions may run at once; they do not influence each other."""
    with Stream(subject.client) as one, Stream(subject.client) as other:
        player = Player(one, Recording(subject.spec, subject.arenas), subject.start())
        second = Player(other, Recording(subject.spec, 1), subject.start(arenas=1, seed=9))
        for _ in range(SHORT):
            player.decide()
            second.decide()
    expect_same_recording(player.recording, subject.short_session, "beside another session")


@check("SESSION")
def parallel_sessions_with_one_seed_are_independent(subject: Subject) -> None:
    """Any number of sessions may run at once; they do not influence each other, also if their seeds are the same."""
    with Stream(subject.client) as one, Stream(subject.client) as other:
        players = [Player(s, Recording(subject.spec, subject.arenas), subject.start()) for s in (one, other)]
        for _ in range(SHORT):
            for player in players:
                player.decide()
    for player in players:
        expect_same_recording(player.recording, subject.short_session, "beside a session with the same seed")


@check("SESSION")
def many_sessions_can_be_open_at_once(subject: Subject) -> None:
    """Any number of sessions may run at once on one server."""
    with ExitStack() as stack:
        for index in range(MANY_SESSIONS):
            answer = stack.enter_context(Stream(subject.client)).ask(subject.start(seed=index))
            expect(not isinstance(answer, Status), f"{answer} in session {index + 1}", "a session")


@check("SESSION")
def reset_does_not_affect_other_sessions(subject: Subject) -> None:
    """Sessions do not influence each other."""
    with Stream(subject.client) as one, Stream(subject.client) as other:
        player = Player(one, Recording(subject.spec, subject.arenas), subject.start())
        second = Player(other, Recording(subject.spec, subject.arenas), subject.start())
        for _ in range(SHORT):
            second.send(reset_request(5))
            player.decide()
    expect_same_recording(player.recording, subject.short_session, "beside a session that was reset")


@check("ERRORS")
def error_does_not_affect_other_sessions(subject: Subject) -> None:
    """Every error ends its own session only."""
    with Stream(subject.client) as one:
        player = Player(one, Recording(subject.spec, subject.arenas), subject.start())
        for _ in range(SHORT):
            subject.play(subject.start(), pb.PlayRequest())
            player.decide()
    expect_same_recording(player.recording, subject.short_session, "beside sessions with errors")


@check("SESSION")
def stream_without_requests_ends_with_ok(subject: Subject) -> None:
    """A stream ends with OK after the client has closed its half, also before a Start."""
    exchange = subject.play()
    expect_equal(exchange.status, OK, "status")


@check("SESSION")
def stream_ends_with_ok_after_the_last_request(subject: Subject) -> None:
    """A stream ends with OK after the client has closed its half."""
    exchange = subject.play(*subject.short_session.requests[:3])
    expect(exchange.status == OK, exchange.status, "OK")


@check("SESSION")
def half_closed_stream_ends_with_ok(subject: Subject) -> None:
    """A stream ends with OK after the client has closed its half; the server does not wait for more requests."""
    with Stream(subject.client) as stream:
        stream.ask(subject.start())
        answer = stream.half_close()
        expect(answer == OK, answer if isinstance(answer, Status) else "another response", "OK")


@check("SESSION")
def cancelled_session_does_not_affect_others(subject: Subject) -> None:
    """A session that is cancelled frees its own arenas only."""
    with Stream(subject.client) as one:
        player = Player(one, Recording(subject.spec, subject.arenas), subject.start())
        requests = subject.short_session.requests
        for _ in range(SHORT):
            with Stream(subject.client) as other:
                other.ask(subject.start(seed=9))
                other.requests.put(requests[1] if len(requests) > 1 else pb.PlayRequest())
                other.cancel()  # while the server works on the last request
            player.decide()
    expect_same_recording(player.recording, subject.short_session, "beside cancelled sessions")


@check("SESSION")
def lost_connection_does_not_affect_other_sessions(subject: Subject) -> None:
    """A session that loses its connection frees its own arenas only."""
    with Stream(subject.client) as one:
        player = Player(one, Recording(subject.spec, subject.arenas), subject.start())
        for _ in range(3):
            with subject.client.another() as second:
                lost = Stream(second)
                lost.ask(subject.start(seed=9))
                second.close()  # with the session still open
                lost.requests.put(None)
            player.decide()
        for _ in range(SHORT - 3):
            player.decide()
    expect_same_recording(player.recording, subject.short_session, "beside lost connections")


def _abandon(client: Client, start: pb.PlayRequest, way: str) -> None:
    """Open some sessions and end them in one way. A session that the server refuses has ended already."""
    with client.another() as connection, ExitStack() as stack:
        streams = [stack.enter_context(Stream(connection)) for _ in range(MANY_SESSIONS)]
        for stream in streams:
            stream.requests.put(start)
        for stream in streams:
            stream.receive()
        if way == "lost with their connection":
            connection.close()
        if way == "refused a request":
            for stream in streams:
                stream.ask(pb.PlayRequest())


def _expect_room(client: Client, start: pb.PlayRequest, when: str) -> None:
    """Raise Violation unless the server accepts a session within ROOM_SECONDS."""
    until = time.monotonic() + ROOM_SECONDS
    while True:
        with Stream(client) as stream:
            answer = stream.ask(start)
        if not isinstance(answer, Status) or answer.code != RESOURCE_EXHAUSTED:
            return
        if time.monotonic() > until:
            raise Violation(f"{answer} after {when}", "a session")
        time.sleep(0.05)


@check("DETERMINISM")
def second_connection_gives_the_same_bytes(subject: Subject) -> None:
    """The same bytes, whatever the session or the transport."""
    with subject.client.another() as other:
        expect_same_recording(subject.record(client=other), subject.short_session, "on another connection")


@check("DETERMINISM")
def requests_sent_at_once_give_the_same_bytes(subject: Subject) -> None:
    """Requests are answered in order, whether or not the client waits for each response."""
    got = Recording(subject.spec, subject.arenas, steps=subject.expect_steps(subject.short_session.requests))
    expect_same_recording(got, subject.short_session, "with all requests sent at once")


@check("ERRORS")
def server_works_after_many_errors(subject: Subject) -> None:
    """Every error ends its own session only, and does not affect later ones."""
    for _ in range(MANY_SESSIONS):
        subject.play(act_request(pb.Act()))
        subject.play(subject.start(arenas=0))
        subject.play(subject.start(), act_request(pb.Act()))
    expect_same_recording(subject.record(), subject.short_session, "after many errors")
