"""Limits: a server refuses what is too large or malformed, and continues to work."""

from collections.abc import Callable

import grpc

from joybridge.conformance.client import OK
from joybridge.conformance.expectations import Suspicion, expect
from joybridge.conformance.registry import check, table
from joybridge.conformance.subject import INVALID_ARGUMENT, NOT_FOUND, RESOURCE_EXHAUSTED, Subject, expect_error
from joybridge.contract.limits import request_bytes
from joybridge.v1 import bridge_pb2 as pb

OVERSIZED = 8 * 2**20  # bytes: twice gRPC's default limit
MAX_SENT = 64 * 2**20  # bytes: larger messages are not sent
LONG_NAME = 100_000  # characters


ARENAS = (  # name, section, rule, the number of arenas under a spec, the status
    ("zero_arenas_are_refused", "Start", "A session has at least 1 arena.", lambda spec: 0, INVALID_ARGUMENT),
    (
        "more_than_max_arenas_are_refused",
        "ERRORS",
        "More arenas than the server accepts are refused with RESOURCE_EXHAUSTED.",
        lambda spec: spec.max_arenas + 1,
        RESOURCE_EXHAUSTED,
    ),
    (
        "largest_number_of_arenas_is_refused",
        "ERRORS",
        "2^32 - 1 arenas are refused with RESOURCE_EXHAUSTED before the server creates any of them.",
        lambda spec: 2**32 - 1,
        RESOURCE_EXHAUSTED,
    ),
)


@table(ARENAS)
def _arenas_are_refused(subject: Subject, arenas: Callable[[pb.GameSpec], int], code: grpc.StatusCode) -> None:
    subject.expect_refused(subject.start(arenas(subject.spec)), codes=[code], words=["arenas"])


@check("ERRORS", per_server=True)
def oversized_message_is_refused(subject: Subject) -> None:
    """A message with more bytes than any game needs is refused with RESOURCE_EXHAUSTED before it is read."""
    specs = [subject.client.describe(game.name) for game in subject.client.list_games()]
    needed = max(request_bytes(spec, spec.max_arenas) for spec in specs)
    size = 2 * needed + OVERSIZED
    exchange = subject.play(pb.PlayRequest(start=pb.Start(game="x" * min(size, MAX_SENT), arenas=1)))
    # A server that accepts so many bytes still has no game of that name.
    expect_error(exchange.status, [RESOURCE_EXHAUSTED, NOT_FOUND], [])
    if exchange.status.code == NOT_FOUND and size <= MAX_SENT:
        raise Suspicion(f"a message of {size} bytes was read", f"a limit: no request needs more than {needed} bytes")


@check("ERRORS", per_server=True)
def very_long_name_is_refused(subject: Subject) -> None:
    """An unknown game is NOT_FOUND, also if its name is too long for the text of a gRPC status."""
    exchange = subject.play(pb.PlayRequest(start=pb.Start(game="x" * LONG_NAME, arenas=1)))
    expect_error(exchange.status, [NOT_FOUND, RESOURCE_EXHAUSTED], [])  # the message may be too large as well


@check("ERRORS", per_server=True)
def malformed_message_is_refused(subject: Subject) -> None:
    """Bytes that are not a PlayRequest end the session with an error."""
    for data in (b"\xff", b"\x0a\x7f", b"\x0a\x03\x0a\x01\xff"):
        exchange = subject.play(data)
        # In most languages gRPC decodes the message and chooses the status.
        refused = exchange.status.code not in (OK.code, grpc.StatusCode.UNAVAILABLE) and not exchange.responses
        expect(refused, exchange.status, "an error that ends this session only")


@check("ERRORS", per_server=True)
def server_works_after_invalid_messages(subject: Subject) -> None:
    """Every error ends its own session only."""
    for request in (b"\xff", pb.PlayRequest(start=pb.Start(game="x" * OVERSIZED, arenas=1))):
        subject.play(request)
        subject.client.list_games()
