"""Protection: calls without the token are refused, and so are compressed messages."""

from collections.abc import Iterator
from dataclasses import replace

import grpc
from grpc_reflection.v1alpha import reflection_pb2

from joybridge.conformance.client import OK, SERVICE, Client, Status
from joybridge.conformance.expectations import Suspicion, expect, skip_unless
from joybridge.conformance.registry import check
from joybridge.conformance.subject import NOT_FOUND, Subject
from joybridge.v1 import bridge_pb2 as pb

UNAUTHENTICATED = grpc.StatusCode.UNAUTHENTICATED
REFLECTION = "reflection"
SIZE = 10_000  # bytes of a message before it is compressed: fewer than any server accepts


@check("SECURITY", per_server=True)
def calls_without_the_token_are_unauthenticated(subject: Subject) -> None:
    """Every call without the token is UNAUTHENTICATED."""
    _expect_unauthenticated(subject, "")


@check("SECURITY", per_server=True)
def calls_with_another_token_are_unauthenticated(subject: Subject) -> None:
    """Every call with another token is UNAUTHENTICATED, also if it is nearly the right one."""
    token = _token(subject)
    other_end = token[:-1] + ("a" if token[-1] != "a" else "b")
    for wrong in (other_end, token[:-1], token + token[-1], token.swapcase() if token.swapcase() != token else "x"):
        _expect_unauthenticated(subject, wrong)


@check("SECURITY", per_server=True)
def health_needs_no_token(subject: Subject) -> None:
    """A server answers grpc.health.v1 without the token."""
    _token(subject)
    with subject.client.another(replace(subject.client.credentials, token="")) as stranger:
        stranger.expect_serving(SERVICE)


@check("SECURITY", per_server=True)
def compressed_messages_are_refused(subject: Subject) -> None:
    """A server should refuse compressed messages: a small one may hold gigabytes."""
    start = pb.PlayRequest(start=pb.Start(game="x" * SIZE, arenas=1))
    exchange = subject.client.play([start], compression=grpc.Compression.Gzip)
    expect(exchange.status != OK, exchange.status, "an error")
    if exchange.status.code == NOT_FOUND:
        raise Suspicion("a message that was compressed with gzip was unpacked", "UNIMPLEMENTED")


def _token(subject: Subject) -> str:
    token: str = subject.client.credentials.token
    skip_unless(token, "the kit was given no token")
    return token


def _expect_unauthenticated(subject: Subject, wrong: str) -> None:
    """Raise Violation unless every call with a wrong token ("": none) is refused, with a text that has no token."""
    token = _token(subject)
    with subject.client.another(replace(subject.client.credentials, token=wrong)) as stranger:
        for call, status in _calls(stranger):
            if call == REFLECTION and status.code == grpc.StatusCode.UNIMPLEMENTED:
                continue  # the server has another version of it, which `health_and_reflection` tests
            what = "with another token" if wrong else "without the token"
            expect(status.code == UNAUTHENTICATED, f"{status.code.name} from {call} {what}", "UNAUTHENTICATED")
            expect(token not in status.details, f"the token in the error of {call}", "an error without it")


def _calls(stranger: Client) -> Iterator[tuple[str, Status]]:
    """Make each call and yield its name and how it ended."""
    for name, request, response in (
        ("ListGames", pb.ListGamesRequest(), pb.ListGamesResponse),
        ("DescribeGame", pb.DescribeGameRequest(), pb.DescribeGameResponse),
    ):
        answer = stranger.call(f"/{SERVICE}/{name}", request, response)
        yield name, answer if isinstance(answer, Status) else OK
    yield "Play", stranger.play([pb.PlayRequest(start=pb.Start(arenas=1))]).status
    yield "Play without a request", stranger.play([]).status
    question = reflection_pb2.ServerReflectionRequest(list_services="").SerializeToString()
    for version in ("v1", "v1alpha"):
        method = f"/grpc.reflection.{version}.ServerReflection/ServerReflectionInfo"
        exchange = stranger.play([question], method=method, response=reflection_pb2.ServerReflectionResponse)
        yield REFLECTION, exchange.status
