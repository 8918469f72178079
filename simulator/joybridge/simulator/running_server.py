"""The specs of the games of a running server, in any language, with all options at their defaults."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import grpc

from joybridge.contract.credentials import credentials_of
from joybridge.contract.errors import JoybridgeError
from joybridge.contract.spec import SpecError, check_spec
from joybridge.contract.text import printable
from joybridge.contract.versions import client_version, mismatch
from joybridge.v1 import bridge_pb2 as pb
from joybridge.v1 import bridge_pb2_grpc as rpc

SECONDS = 10.0  # deadline of each call

Call = Callable[[str, Any], Any]  # from the name of a method and a request to the response


class ServerError(JoybridgeError):
    """A server does not answer, does not have a game, or breaks the contract. The message says what to do."""


def describe_all(address: str) -> list[pb.GameSpec]:
    """Return the specs of all games of the server at an address. Raises ServerError."""
    with _calling(address) as call:
        return [_describe(call, address, game) for game in _list_games(call)]


def describe_one(address: str, game: str | None) -> pb.GameSpec:
    """Return the spec of a game of the server at an address, of its only game for None. Raises ServerError."""
    with _calling(address) as call:
        names = _list_games(call)
        if game is None and len(names) == 1:
            game = names[0]
        if game not in names:
            missing = "choose one with --game" if game is None else f"--game {game} is none of them"
            raise ServerError(f"the server at {address} has {printable(', '.join(names))}; {missing}")
        return _describe(call, address, game)


def _list_games(call: Call) -> list[str]:
    response = call("ListGames", pb.ListGamesRequest(version=client_version()))
    return [summary.name for summary in response.games]


def _describe(call: Call, address: str, game: str) -> pb.GameSpec:
    version = client_version()
    response: pb.DescribeGameResponse = call("DescribeGame", pb.DescribeGameRequest(game=game, version=version))
    if text := mismatch(version, response.version):
        raise ServerError(f"{address}: {text}")
    try:
        check_spec(response.spec)
    except SpecError as error:
        raise ServerError(
            f"the server at {address} sent a spec that breaks the contract: {error}; run `joybridge check {address}`"
        ) from error
    return response.spec


@contextmanager
def _calling(address: str) -> Iterator[Call]:
    """Yield a function that calls a method of the server at an address. Raises ServerError for calls that fail."""
    credentials = credentials_of(address)
    try:
        with credentials.channel(address) as channel:
            stub = rpc.SimulatorServiceStub(channel)
            yield lambda method, request: getattr(stub, method)(request, timeout=SECONDS, metadata=credentials.metadata)
    except grpc.RpcError as error:
        reason = printable(f"{error.details()} ({error.code().name})")
        if error.code() in (grpc.StatusCode.UNAVAILABLE, grpc.StatusCode.DEADLINE_EXCEEDED):
            reason = f"no answer from a server at {address}: {reason}; start it, or check the address"
        else:
            reason = f"the server at {address} refuses to list or describe its games: {reason}"
        raise ServerError(reason) from error
