"""Sessions: several run at once, are independent of each other, and end with their stream."""

import time
from collections.abc import Callable, Generator
from contextlib import ExitStack, closing

from joybridge.conformance.client import OK, Client, Status, Stream
from joybridge.conformance.expectations import Violation, expect, skip_unless
from joybridge.conformance.recording import Recording, act_request, expect_same_recording, reset_request
from joybridge.conformance.registry import check, table
from joybridge.conformance.subject import RESOURCE_EXHAUSTED, SHORT, Subject
from joybridge.v1 import bridge_pb2 as pb

MANY_SESSIONS = 8
ABANDONED = 72  # sessions that end in each way: more than servers accept at once by default
LOST = 3  # connections
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
def parallel_sessions_with_one_seed_are_independent(subject: Subject) -> None:
    """Any number of sessions may run at once; they do not influence each other, also if their seeds are the same."""
    with Stream(subject.client) as one, Stream(subject.client) as other:
        players = [subject.player(stream) for stream in (one, other)]
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


def _play_another(subject: Subject) -> Generator[None]:
    with Stream(subject.client) as stream:
        other = subject.player(stream, arenas=1, seed=9)
        while True:
            yield
            other.decide()


def _reset_another(subject: Subject) -> Generator[None]:
    with Stream(subject.client) as stream:
        other = subject.player(stream)
        while True:
            other.send(reset_request(5))
            yield


def _cause_errors(subject: Subject) -> Generator[None]:
    while True:
        subject.play(subject.start(), pb.PlayRequest())
        yield


def _cancel_others(subject: Subject) -> Generator[None]:
    requests = subject.short_session.requests
    while True:
        with Stream(subject.client) as other:
            other.ask(subject.start(seed=9))
            other.requests.put(requests[1] if len(requests) > 1 else pb.PlayRequest())
            other.cancel()  # while the server works on the last request
        yield


def _lose_connections(subject: Subject) -> Generator[None]:
    for _ in range(LOST):
        with subject.client.another() as connection:
            lost = Stream(connection)
            lost.ask(subject.start(seed=9))
            connection.close()  # with the session still open
            lost.requests.put(None)
        yield


BESIDE = (  # name, section, rule, what happens before each decision of a session, what it is beside
    ("parallel_sessions_are_independent", "SESSION",
     "Any number of sessions may run at once; they do not influence each other.",
     _play_another, "another session"),
    ("reset_does_not_affect_other_sessions", "SESSION",
     "Sessions do not influence each other.", _reset_another, "a session that was reset"),
    ("error_does_not_affect_other_sessions", "ERRORS",
     "Every error ends its own session only.", _cause_errors, "sessions with errors"),
    ("cancelled_session_does_not_affect_others", "SESSION",
     "A session that is cancelled frees its own arenas only.", _cancel_others, "cancelled sessions"),
    ("lost_connection_does_not_affect_other_sessions", "SESSION",
     "A session that loses its connection frees its own arenas only.", _lose_connections, "lost connections"),
)  # fmt: skip


@table(BESIDE)
def _session_is_independent(subject: Subject, happens: Callable[[Subject], Generator[None]], beside: str) -> None:
    with Stream(subject.client) as stream, closing(happens(subject)) as events:
        player = subject.player(stream)
        for _ in range(SHORT):
            next(events, None)
            player.decide()
    expect_same_recording(player.recording, subject.short_session, f"beside {beside}")


CLOSED = (  # name, section, rule, how many requests are sent before the client closes its half
    (
        "stream_without_requests_ends_with_ok",
        "SESSION",
        "A stream ends with OK after the client has closed its half, also before a Start.",
        0,
    ),
    (
        "stream_ends_with_ok_after_the_last_request",
        "SESSION",
        "A stream ends with OK after the client has closed its half.",
        3,
    ),
)


@table(CLOSED)
def _stream_ends_with_ok(subject: Subject, requests: int) -> None:
    sent = subject.short_session.requests[:requests] if requests else []
    status = subject.play(*sent).status
    expect(status == OK, status, "OK")


@check("SESSION")
def half_closed_stream_ends_with_ok(subject: Subject) -> None:
    """A stream ends with OK after the client has closed its half; the server does not wait for more requests."""
    with Stream(subject.client) as stream:
        stream.ask(subject.start())
        answer = stream.half_close()
        expect(answer == OK, answer if isinstance(answer, Status) else "another response", "OK")


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
    with subject.client.another() as connection:
        other = Subject(connection, subject.game, subject.options)
        expect_same_recording(other.record(), subject.short_session, "on another connection")


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
