"""One Play stream over gRPC: requests and responses in turns. Its methods run on the event loop."""

import asyncio
from contextlib import suppress
from typing import Any

import grpc

from joybridge.trainer.wire.errors import SimulatorError, SimulatorLost, from_grpc
from joybridge.v1 import bridge_pb2 as pb
from joybridge.v1 import bridge_pb2_grpc as rpc

ATTEMPTS = 10  # to open a stream
# Pings detect a machine that has disappeared. By default, gRPC servers end connections that ping more often than
# every five minutes.
KEEPALIVE = [("grpc.keepalive_time_ms", 330_000), ("grpc.keepalive_timeout_ms", 20_000)]


class Stream:
    """A Play stream to the simulator at an address."""

    def __init__(self, address: str, max_response_bytes: int) -> None:
        self.address = address
        self._options = [
            ("grpc.max_receive_message_length", max_response_bytes),
            ("grpc.max_send_message_length", -1),
            *KEEPALIVE,
        ]
        self._channel: Any = None
        self._call: Any = None
        self._pending: asyncio.Task[pb.PlayResponse] | None = None  # the response to the last `send`

    async def open(self, request: pb.PlayRequest) -> pb.PlayResponse:
        """Open the stream and return the response to its first request. Raises SimulatorError.

        A server may reject a stream before it reads the request. gRPC then reports either the server's reason, or only
        that the request could not be sent. In the second case, try again.
        """
        for _ in range(ATTEMPTS):
            self._channel = grpc.aio.insecure_channel(self.address, options=self._options)
            self._call = rpc.SimulatorServiceStub(self._channel).Play()
            try:
                return await self.exchange(request)
            except _NotSent:
                await self.close()
        raise SimulatorLost(
            f"the simulator at {self.address} rejected the session {ATTEMPTS} times without a reason; see its log"
        )

    async def exchange(self, request: pb.PlayRequest) -> pb.PlayResponse:
        """Send a request and return the response. Raises SimulatorError.

        A response that was not received, because an interrupt came after `send`, is dropped first: gRPC does not
        support two reads at a time.
        """
        if self._pending is not None:
            await self.receive()
        return await self._exchange(request)

    async def _exchange(self, request: pb.PlayRequest) -> pb.PlayResponse:
        try:
            await self._call.write(request)
        except asyncio.InvalidStateError:
            pass  # the stream has ended; reading from it raises the reason
        except grpc.RpcError as error:
            raise _NotSent(f"lost the simulator at {self.address}: the stream has ended") from error
        try:
            response: pb.PlayResponse = await self._call.read()
        except grpc.RpcError as error:
            raise from_grpc(error, self.address) from error
        if response is grpc.aio.EOF:
            raise SimulatorLost(f"the simulator at {self.address} ended the session")
        return response

    async def send(self, request: pb.PlayRequest) -> None:
        """Send a request without waiting for the response; `receive` returns it."""
        if self._pending is not None:
            await self.receive()
        self._pending = asyncio.create_task(self._exchange(request))
        await asyncio.sleep(0)  # lets the task begin to send

    async def receive(self) -> pb.PlayResponse:
        """Return the response to the last `send`. Raises SimulatorError."""
        if self._pending is None:
            raise SimulatorError("receive() without send(): no response is on its way")
        pending, self._pending = self._pending, None
        return await pending

    async def close(self) -> None:
        """End the stream, if it is open."""
        if self._pending is not None:
            self._pending.cancel()
            with suppress(asyncio.CancelledError, SimulatorError):
                await self._pending
            self._pending = None
        if self._channel is not None:
            self._call.cancel()
            await self._channel.close()


class _NotSent(SimulatorLost):
    """A request could not be sent: the stream has ended."""
