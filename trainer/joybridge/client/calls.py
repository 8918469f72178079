"""Calls without a session: wait for a simulator, list its games, and read the spec of one. All functions block."""

import asyncio
import math
import time
from collections.abc import Callable, Mapping
from typing import TypeVar

import grpc
from google.protobuf.message import Message

from joybridge.client.errors import SimulatorError, SimulatorLost, from_grpc
from joybridge.client.interruptible_loop import EVENT_LOOP
from joybridge.client.reachability import why_unreachable
from joybridge.client.responses import parse
from joybridge.client.stream import SERVICE
from joybridge.contract.credentials import credentials_of
from joybridge.contract.limits import MAX_NAME
from joybridge.contract.spec import SpecError, check_spec
from joybridge.contract.versions import client_version, mismatch
from joybridge.v1 import bridge_pb2 as pb

_OFTEN = [("grpc.max_reconnect_backoff_ms", 1000)]  # tries to connect; by default the pauses grow to two minutes
CALL_SECONDS = 30.0  # to wait for an answer, by default
M = TypeVar("M", bound=Message)


def wait_for(address: str, seconds: float, say: Callable[[str], None]) -> None:
    """Wait until a simulator can be reached at an address. Raises SimulatorLost after so many seconds.

    say: called after each second with what is waited for.
    """
    try:
        EVENT_LOOP.run(_connect, address, seconds, say)
    except TimeoutError:
        raise SimulatorLost(
            f"no simulator at {address} after {seconds:g} s: {why_unreachable(address)}; start one there with "
            f"`joybridge serve --address {address}`, or check the address"
        ) from None


def list_games(address: str) -> list[str]:
    """Return the names of a simulator's games. Raises SimulatorError."""
    try:
        request = pb.ListGamesRequest(version=client_version())
        response = EVENT_LOOP.run(_call, address, "ListGames", request, pb.ListGamesResponse)
    except grpc.RpcError as error:
        raise from_grpc(error, address) from error
    names = [game.name for game in response.games]
    if not names or not all(1 <= len(name) <= MAX_NAME and name.isprintable() for name in names):
        raise SimulatorError(
            f"the simulator at {address} sent {len(names)} games, expected at least one, with printable names of 1 to "
            f"{MAX_NAME} characters"
        )
    return names


def describe(address: str, game: str, options: Mapping[str, str]) -> pb.GameSpec:
    """Return the spec of a game with some options.

    Raises SimulatorError if the simulator refuses, sends a spec that breaks the contract, or has an older revision of
    the contract than this client.
    """
    return description_of(address, game, options).spec


def description_of(address: str, game: str, options: Mapping[str, str]) -> pb.DescribeGameResponse:
    """Return a checked spec with the version of the simulator. Raises SimulatorError as `describe` does."""
    request = pb.DescribeGameRequest(game=game, options=options, version=client_version())
    try:
        response = EVENT_LOOP.run(_call, address, "DescribeGame", request, pb.DescribeGameResponse)
        if text := mismatch(client_version(), response.version):
            raise SimulatorError(f"{address}: {text}")
        check_spec(response.spec)
    except grpc.RpcError as error:
        raise from_grpc(error, address) from error
    except SpecError as error:
        raise SimulatorError(f"the simulator at {address} sent a spec that breaks the contract: {error}") from error
    return response


async def _connect(address: str, seconds: float, say: Callable[[str], None]) -> None:
    """Connect once. Raises TimeoutError."""
    limit = time.monotonic() + seconds
    async with credentials_of(address).aio_channel(address, _OFTEN) as channel:
        ready = asyncio.ensure_future(channel.channel_ready())
        try:
            while not (await asyncio.wait([ready], timeout=min(1.0, max(0.0, limit - time.monotonic()))))[0]:
                if (left := limit - time.monotonic()) <= 0.0:
                    raise TimeoutError
                say(f"waiting for a simulator at {address}, {math.ceil(left)} s more: {why_unreachable(address)}")
            await ready
        finally:
            ready.cancel()


async def _call(address: str, method: str, request: Message, response: type[M]) -> M:
    """Call a method and return its response. Raises grpc.RpcError and SimulatorError."""
    credentials = credentials_of(address)
    async with credentials.aio_channel(address) as channel:
        call = channel.unary_unary(f"/{SERVICE}/{method}", type(request).SerializeToString)
        data = await call(request, timeout=CALL_SECONDS, metadata=credentials.metadata)
    return parse(response, data, address)
