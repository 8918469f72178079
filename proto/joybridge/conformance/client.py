"""A client that sends any request, valid or not, and reports how each call ended. Every call has a deadline."""

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from queue import SimpleQueue
from threading import Event, Thread
from time import monotonic
from typing import Any, Literal, Self, TypeAlias

import grpc
from grpc_health.v1 import health_pb2

from joybridge.conformance.expectations import TimedOut, Violation, expect
from joybridge.conformance.local_call import LocalCall
from joybridge.contract.credentials import Credentials
from joybridge.v1 import bridge_pb2 as pb

SERVICE = "joybridge.v1.SimulatorService"
_OPTIONS = [
    ("grpc.max_receive_message_length", -1),
    ("grpc.max_send_message_length", -1),
    ("grpc.use_local_subchannel_pool", 1),  # closing a channel must close its connection
]
Request = pb.PlayRequest | bytes  # bytes are sent as they are
MIN_WAIT = 0.1  # seconds; a shorter wait may last this long
Transport: TypeAlias = Literal["grpc", "local"]
OPEN = Credentials()  # no TLS and no token


@dataclass(frozen=True)
class Status:
    """The gRPC status with which a call ended."""

    code: grpc.StatusCode
    details: str

    def __str__(self) -> str:
        return f"{self.code.name} {self.details[:300]!r}"


OK = Status(grpc.StatusCode.OK, "")


@dataclass(frozen=True)
class Exchange:
    """The responses of one stream and the status with which it ended."""

    responses: list[Any]  # of Play: PlayResponse
    status: Status


def wait_for_server(address: str, seconds: float, credentials: Credentials) -> None:
    """Wait until a server can be reached, or for so many seconds: what is missing then is for the checks to say."""
    often = ("grpc.max_reconnect_backoff_ms", 1000)  # by default the pauses grow to two minutes
    with credentials.channel(address, [*_OPTIONS, often]) as channel, suppress(grpc.FutureTimeoutError):
        grpc.channel_ready_future(channel).result(timeout=seconds)


class Client:
    """One connection to the server under test."""

    def __init__(
        self, address: str, seconds: float, credentials: Credentials = OPEN, transport: Transport = "grpc"
    ) -> None:
        """Connect. `seconds` is the longest wait for a response, `transport` that of the messages of sessions."""
        self.address = address
        self.seconds = seconds
        self.credentials = credentials
        self.transport: Transport = transport
        self.channel = credentials.channel(address, _OPTIONS)

    def another(self, credentials: Credentials | None = None) -> "Client":
        """Return another connection to the same server, with other credentials if they are given."""
        credentials = self.credentials if credentials is None else credentials
        return Client(self.address, self.seconds, credentials, self.transport)

    def call(self, method: str, request: Any, response: Any) -> Any:
        """Make a unary call and return its response, or the status of a failed call. Raises TimedOut."""
        send = self.channel.unary_unary(method, encode, response.FromString)
        try:
            return send(request, timeout=self.seconds, metadata=self.credentials.metadata)
        except grpc.RpcError as error:
            return _status(error, self.seconds)

    def try_list_games(self) -> list[pb.GameSummary] | Status:
        """Return the games of the server, or the status of a failed call. Raises TimedOut."""
        answer = self.call(f"/{SERVICE}/ListGames", pb.ListGamesRequest(), pb.ListGamesResponse)
        return answer if isinstance(answer, Status) else list(answer.games)

    def list_games(self) -> list[pb.GameSummary]:
        """Return the games of the server. Raises Violation if the call fails."""
        games: list[pb.GameSummary] = _expect_response(self.try_list_games(), "ListGames")
        return games

    def try_describe(self, game: str, options: Mapping[str, str]) -> pb.GameSpec | Status:
        """Return a spec, or the status of a failed call. Raises TimedOut."""
        request = pb.DescribeGameRequest(game=game, options=options)
        answer = self.call(f"/{SERVICE}/DescribeGame", request, pb.DescribeGameResponse)
        return answer if isinstance(answer, Status) else answer.spec

    def describe(self, game: str, options: Mapping[str, str] | None = None) -> pb.GameSpec:
        """Return a spec. Raises Violation if the call fails."""
        answer = self.try_describe(game, options or {})
        spec: pb.GameSpec = _expect_response(answer, f"DescribeGame({game!r}, {dict(options or {})})")
        return spec

    def expect_serving(self, service: str) -> None:
        """Raise Violation unless grpc.health.v1 says that a service, or the server (""), is serving."""
        request = health_pb2.HealthCheckRequest(service=service)
        answer = self.call("/grpc.health.v1.Health/Check", request, health_pb2.HealthCheckResponse)
        serving = not isinstance(answer, Status) and answer.status == health_pb2.HealthCheckResponse.SERVING
        expect(serving, f"the health of service {service!r} is {str(answer).strip()}", "SERVING")

    def play(self, requests: Sequence[Any], **fields: Any) -> Exchange:
        """Send all requests of a stream at once. `fields` are those of `stream`. Raises TimedOut."""
        responses: list[Any] = []
        with _Receiver(self.stream(iter(requests), **fields), self.seconds) as receiver:
            while not isinstance(response := receiver.receive(), Status):
                responses.append(response)
        return Exchange(responses, response)

    def stream(
        self, requests: Iterator[Any], method: str = f"/{SERVICE}/Play", response: Any = pb.PlayResponse, **fields: Any
    ) -> Any:
        """Open a stream, by default Play, and return the iterator of its responses. `fields` are gRPC's."""
        call = self.channel.stream_stream(method, encode, response.FromString)
        open_stream = partial(call, metadata=self.credentials.metadata, **fields)
        if self.transport == "local" and response is pb.PlayResponse:
            return LocalCall(open_stream, requests, self.seconds)
        return open_stream(requests)

    def close(self) -> None:
        """Close the connection and every stream on it."""
        self.channel.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class Stream:
    """One Play stream, used one request at a time."""

    def __init__(self, client: Client) -> None:
        """Open a stream."""
        self.requests: SimpleQueue[Request | None] = SimpleQueue()
        self.responses = client.stream(iter(self.requests.get, None))
        self.receiver = _Receiver(self.responses, client.seconds)

    def ask(self, request: Request) -> pb.PlayResponse | Status:
        """Send a request and return its response, or the status if the stream ended. Raises TimedOut."""
        self.requests.put(request)
        return self.receive()

    def receive(self) -> pb.PlayResponse | Status:
        """Return the next response, or the status if the stream ended. Raises TimedOut."""
        response: pb.PlayResponse | Status = self.receiver.receive()
        return response

    def half_close(self) -> pb.PlayResponse | Status:
        """Close the client's half of the stream and return the next response or the status. Raises TimedOut."""
        self.requests.put(None)
        return self.receive()

    def cancel(self) -> None:
        """Cancel the stream."""
        self.receiver.end()
        self.responses.cancel()  # first: the end of the requests alone would close the stream in order
        self.requests.put(None)  # ends gRPC's thread that waits for the next request

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.cancel()


class _Receiver:
    """Receives the responses of a call, and cancels the call if one of them takes too long.

    A deadline of gRPC would be one of the whole stream, which a slow server may exceed with many quick responses. One
    thread watches all waits of a call, because a timer for each response takes longer than most servers do to answer.
    """

    def __init__(self, responses: Any, seconds: float) -> None:
        """Watch a call. `seconds` is the longest wait for a response."""
        self.responses, self.seconds = responses, seconds
        self.limit = math.inf  # of the current wait, on the clock `monotonic`
        self.late = False
        self.ended = Event()
        Thread(target=self._watch, daemon=True).start()

    def receive(self) -> Any:
        """Return the next response of the call, or its status if it ended. Raises TimedOut."""
        self.limit = monotonic() + self.seconds
        try:
            return next(self.responses)
        except StopIteration:
            return OK
        except grpc.RpcError as error:
            if self.late:
                raise TimedOut(self.seconds) from error
            return _status(error, self.seconds)
        finally:
            self.limit = math.inf

    def end(self) -> None:
        """End the thread."""
        self.ended.set()

    def _watch(self) -> None:
        # A wait that begins while this thread sleeps is longer than this sleep, so its limit is seen in time.
        while not self.ended.wait(min(MIN_WAIT, self.limit - monotonic())):
            if self.limit <= monotonic():
                self.late = True
                self.responses.cancel()
                return

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.end()


def encode(request: Any) -> bytes:
    """Return the bytes of a request; bytes are returned unchanged."""
    return request if isinstance(request, bytes) else request.SerializeToString()


def _status(error: Any, seconds: float) -> Status:
    if error.code() == grpc.StatusCode.DEADLINE_EXCEEDED:
        raise TimedOut(seconds)
    return Status(error.code(), error.details() or "")


def _expect_response(answer: Any, call: str) -> Any:
    if isinstance(answer, Status):
        raise Violation(f"{call} failed with {answer}", "a response")
    return answer
