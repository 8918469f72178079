"""A client that sends what it is told, right or wrong, and waits for nothing longer than its deadline."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from queue import SimpleQueue
from types import TracebackType
from typing import Any, Self

import grpc

from joybridge.conformance.registry import Broken, Silent
from joybridge.v1 import bridge_pb2 as pb

SERVICE = "joybridge.v1.SimulatorService"
_OPTIONS = [
    ("grpc.max_receive_message_length", -1),
    ("grpc.max_send_message_length", -1),
    ("grpc.use_local_subchannel_pool", 1),  # a channel that is torn down must take its connection with it
]
Request = pb.PlayRequest | bytes


@dataclass(frozen=True)
class Ended:
    """How a call ended."""

    code: grpc.StatusCode
    details: str

    def __str__(self) -> str:
        return f"{self.code.name} {self.details[:300]!r}"


OK = Ended(grpc.StatusCode.OK, "")


@dataclass(frozen=True)
class Played:
    """The responses of a stream and how it ended."""

    responses: list[pb.PlayResponse]
    end: Ended

    @property
    def steps(self) -> list[pb.Step]:
        """Return the steps among the responses, the one in Started, too."""
        return [
            response.started.step if response.HasField("started") else response.step
            for response in self.responses
            if not response.HasField("snapshot")
        ]


class Server:
    """A server under test, over one connection."""

    def __init__(self, address: str, seconds: float) -> None:
        """Connect; no call may take longer than `seconds`."""
        self.address = address
        self.seconds = seconds
        self.channel = grpc.insecure_channel(address, _OPTIONS)

    def call(self, method: str, request: Any, response: Any) -> Any:
        """Make a unary call and return its response, or how it ended instead."""
        try:
            return self.channel.unary_unary(method, encode, response.FromString)(request, timeout=self.seconds)
        except grpc.RpcError as error:
            return _ended(error, self.seconds)

    def list_games(self) -> list[pb.GameSummary]:
        """Return the games of the server. Raises Broken if it does not tell."""
        answer = self.call(f"/{SERVICE}/ListGames", pb.ListGamesRequest(), pb.ListGamesResponse)
        return list(_answered(answer, "ListGames").games)

    def try_describe(self, game: str, options: Mapping[str, str]) -> pb.GameSpec | Ended:
        """Return a spec, or how the call ended instead."""
        request = pb.DescribeGameRequest(game=game, options=options)
        answer = self.call(f"/{SERVICE}/DescribeGame", request, pb.DescribeGameResponse)
        return answer if isinstance(answer, Ended) else answer.spec

    def describe(self, game: str, options: Mapping[str, str] | None = None) -> pb.GameSpec:
        """Return a spec. Raises Broken if there is none."""
        spec: pb.GameSpec = _answered(self.try_describe(game, options or {}), f"DescribeGame of {game} {options or ''}")
        return spec

    def play(self, requests: Sequence[Request]) -> Played:
        """Send all requests of a stream at once and return what came of it. Raises Silent."""
        stream = self.stream(iter(requests))
        responses: list[pb.PlayResponse] = []
        try:
            responses.extend(stream)
        except grpc.RpcError as error:
            return Played(responses, _ended(error, self.seconds))
        return Played(responses, OK)

    def stream(self, requests: Iterator[Request]) -> Any:
        """Return the responses of a new stream."""
        play = self.channel.stream_stream(f"/{SERVICE}/Play", encode, pb.PlayResponse.FromString)
        return play(requests, timeout=self.seconds)

    def close(self) -> None:
        """Drop the connection, whatever is still open on it."""
        self.channel.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


class Stream:
    """One session, request by request."""

    def __init__(self, server: Server) -> None:
        """Open a stream."""
        self.seconds = server.seconds
        self.requests: SimpleQueue[Request | None] = SimpleQueue()
        self.responses = server.stream(iter(self.requests.get, None))

    def ask(self, request: Request) -> pb.PlayResponse | Ended:
        """Send a request and return its response, or how the stream ended instead. Raises Silent."""
        self.requests.put(request)
        return self.next()

    def next(self) -> pb.PlayResponse | Ended:
        """Wait for the next response, or for the end of the stream. Raises Silent."""
        try:
            response: pb.PlayResponse = next(self.responses)
        except StopIteration:
            return OK
        except grpc.RpcError as error:
            return _ended(error, self.seconds)
        return response

    def finish(self) -> pb.PlayResponse | Ended:
        """Close this end of the stream and return what comes then. Raises Silent."""
        self.requests.put(None)
        return self.next()

    def cancel(self) -> None:
        """Break the stream off."""
        self.requests.put(None)  # the thread that sends is still waiting for it
        self.responses.cancel()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.cancel()


def encode(request: Any) -> bytes:
    """Return the bytes of a request; bytes are sent as they are."""
    return request if isinstance(request, bytes) else request.SerializeToString()


def _ended(error: Any, seconds: float) -> Ended:
    if error.code() == grpc.StatusCode.DEADLINE_EXCEEDED:
        raise Silent(f"no answer within {seconds:g} s", "an answer")
    return Ended(error.code(), error.details() or "")


def _answered(answer: Any, call: str) -> Any:
    if isinstance(answer, Ended):
        raise Broken(f"{call} ended with {answer}", "an answer")
    return answer
