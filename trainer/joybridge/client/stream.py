"""One Play stream over gRPC: requests out, responses in, in turns."""

import asyncio
import math
from collections.abc import Awaitable
from contextlib import suppress
from typing import Any, TypeVar, cast

import grpc

from joybridge.client.errors import SimulatorError, SimulatorLost, from_grpc
from joybridge.client.interruptible_loop import EVENT_LOOP
from joybridge.client.responses import Reader, parse
from joybridge.contract.credentials import credentials_of
from joybridge.contract.versions import PINGED_REVISION
from joybridge.v1 import bridge_pb2 as pb

ATTEMPTS = 10  # to open a stream
PAUSE_SECONDS = 0.002  # in which the end of a stream may have come
SERVICE = pb.DESCRIPTOR.services_by_name["SimulatorService"].full_name
# Without a byte of the server, until it is asked whether it is there; for its answer. gRPC's own threads ask and
# answer, so a game that works for long does not look like a machine that has disappeared.
SILENT_MS, ANSWER_MS = 10_000, 4_500
SILENT_MS_BEFORE = 330_000  # for servers that do not say that they accept pings: by default, one in five minutes

T = TypeVar("T")


class ClientStream:
    """A Play stream to a simulator. Its public methods block; the others run on the event loop."""

    def __init__(self, reader: Reader, largest: int, revision: int) -> None:
        """Prepare a stream. reader: of its responses. largest: bytes of a response. revision: of the server."""
        self.address, self._reader = reader.address, reader
        self._late = False  # whether a response did not come in time
        self._heard = math.inf  # when the last response came, in the time of the loop
        self._options = [
            ("grpc.max_receive_message_length", largest),
            ("grpc.max_send_message_length", -1),
            ("grpc.keepalive_time_ms", SILENT_MS if revision >= PINGED_REVISION else SILENT_MS_BEFORE),
            ("grpc.keepalive_timeout_ms", ANSWER_MS),
            ("grpc.http2.ping_timeout_ms", ANSWER_MS),  # by default a minute, whatever keepalive_timeout_ms says
            ("grpc.http2.max_pings_without_data", 0),  # no limit; by default two pings, then one a minute
        ]
        self._channel: Any = None
        self._call: Any = None
        self._pending: asyncio.Task[pb.PlayResponse] | None = None  # the response to the last `send`
        self._listening: asyncio.Task[None] | None = None  # reads the responses; asyncio references tasks weakly
        self._awaited: asyncio.Future[bytes] | None = None  # the response to the last request, until it has come
        self._ended: SimulatorError | None = None  # why no further response is read

    def open(self, start: pb.Start) -> pb.PlayResponse:
        """Open the stream, start the session and return its first response. Raises SimulatorError."""
        return EVENT_LOOP.run(self._open, start)

    def send(self, request: pb.PlayRequest) -> None:
        """Send a request without waiting for the response; `receive` returns it."""
        EVENT_LOOP.run(self._send, request)

    def receive(self) -> pb.PlayResponse:
        """Return the response to the last `send`. Raises SimulatorError."""
        return EVENT_LOOP.run(self._receive)

    def ask(self, request: pb.PlayRequest) -> pb.PlayResponse:
        """Send a request and return its response. Raises SimulatorError."""
        return EVENT_LOOP.run(self._ask, request)

    def reason(self, request: pb.PlayRequest) -> SimulatorError:
        """Wait until the stream ends after a request, and return why it did."""
        return EVENT_LOOP.run(self._reason, request)

    def has_ended(self) -> bool:
        """Return whether the server, or the loss of it, has ended the stream; `reason` then returns why at once."""
        return EVENT_LOOP.run(self._has_ended)

    def close(self) -> None:
        """End the stream, if it is open. Finalizers may call this."""
        EVENT_LOOP.run_soon(self._close)

    async def _open(self, start: pb.Start) -> pb.PlayResponse:
        """Open the stream.

        A server may reject a stream before it reads the request. gRPC then reports either the server's reason, or only
        that the request could not be sent. In the second case, try again.
        """
        credentials = credentials_of(self.address)
        request = pb.PlayRequest(start=start)
        for _ in range(ATTEMPTS):
            self._channel = credentials.aio_channel(self.address, self._options)
            play = self._channel.stream_stream(f"/{SERVICE}/Play", pb.PlayRequest.SerializeToString)
            self._call = play(metadata=credentials.metadata)
            self._ended = None
            self._listening = asyncio.create_task(self._listen(self._call))
            try:
                return await self._wait(self._exchange(request))
            except _NotSent:
                await self._close()
        raise SimulatorLost(
            f"the simulator at {self.address} rejected the session {ATTEMPTS} times without a reason; see its log"
        )

    async def _send(self, request: pb.PlayRequest) -> None:
        await self._prepare()
        self._pending = asyncio.create_task(self._exchange(request))
        await asyncio.sleep(0)  # lets the task begin to send

    async def _receive(self) -> pb.PlayResponse:
        if self._pending is None:
            raise SimulatorError("receive() without send(): no response is on its way")
        pending, self._pending = self._pending, None
        return await self._wait(pending)

    async def _ask(self, request: pb.PlayRequest) -> pb.PlayResponse:
        await self._prepare()
        return await self._wait(self._exchange(request))

    async def _reason(self, request: pb.PlayRequest) -> SimulatorError:
        assert self._listening is not None
        try:
            await self._wait(self._listening)
        except asyncio.CancelledError:
            return self._reader.too_late(request)
        return cast(SimulatorError, self._ended)

    async def _has_ended(self) -> bool:
        await self._let_end_come()
        return self._ended is not None

    async def _close(self) -> None:
        if self._pending is not None:
            self._pending.cancel()
            with suppress(asyncio.CancelledError, SimulatorError):
                await self._pending
            self._pending = None
        if self._listening is not None:
            self._listening.cancel()
        if self._channel is not None:
            self._call.cancel()
            await self._channel.close()
            if self._listening is not None:
                await asyncio.wait([self._listening])
            # The connection lives as long as something refers to these.
            self._channel = self._call = self._listening = None
            await asyncio.sleep(PAUSE_SECONDS)  # gRPC refers to the call until the loop hears of its end

    async def _prepare(self) -> None:
        """Get ready for a request.

        A response that was not received, because an interrupt came after `send`, is dropped: gRPC does not support two
        reads at a time. After a pause, in which the loop did not run, the stream may have ended: if a request were sent
        before the loop has noticed, gRPC would hide the reason.
        """
        if self._pending is not None:
            pending, self._pending = self._pending, None
            await self._wait(pending)
        if asyncio.get_running_loop().time() - self._heard > PAUSE_SECONDS:
            await self._let_end_come()

    async def _let_end_come(self) -> None:
        for _ in range(3):  # for the socket, the queue of gRPC and the task that takes the status
            await asyncio.sleep(0)

    async def _wait(self, response: Awaitable[T]) -> T:
        """Return a response. Raises SimulatorLost if it does not come in time.

        The time begins with the wait, not with the request: a caller may do something else in between. A timer is
        cheaper than asyncio's timeouts. It cancels the wait, not the call: a call that is cancelled before it has begun
        leaves gRPC waiting for ever.
        """
        loop = asyncio.get_running_loop()
        timer = loop.call_later(self._reader.seconds, self._give_up, asyncio.current_task())
        try:
            return await response
        finally:
            timer.cancel()
            self._heard = loop.time()

    def _give_up(self, task: asyncio.Task[Any] | None) -> None:
        assert task is not None
        self._late = True
        task.cancel()

    async def _exchange(self, request: pb.PlayRequest) -> pb.PlayResponse:
        if self._ended is not None:
            raise self._ended
        self._awaited = awaited = asyncio.get_running_loop().create_future()
        try:
            with suppress(asyncio.InvalidStateError):  # the stream has ended; waiting for the response raises why
                await self._call.write(request)
            data = await awaited
        except asyncio.CancelledError:
            if self._late:
                raise self._reader.too_late(request) from None
            raise
        except grpc.RpcError as error:
            raise _NotSent(f"lost the simulator at {self.address}: the stream has ended") from error
        finally:
            awaited.cancel()  # nobody waits for it any more
        return parse(pb.PlayResponse, data, self.address)

    async def _listen(self, call: Any) -> None:
        """Hand each response to the request that waits for it, until the stream ends or a response was not asked for.

        A response is read before the next request is sent. Otherwise one that was not asked for would be taken for the
        answer to that request, and every later response for the answer to the request after its own.
        """
        while self._ended is None:
            try:
                data = await call.read()
                if data is grpc.aio.EOF:
                    self._ended = SimulatorLost(f"the simulator at {self.address} ended the session")
            except grpc.RpcError as error:
                self._ended = from_grpc(error, self.address)
            awaited, self._awaited = self._awaited, None
            if awaited is None or awaited.done():
                self._ended = self._ended or self._reader.surplus()
            elif self._ended is not None:
                awaited.set_exception(self._ended)
            else:
                awaited.set_result(data)


class _NotSent(SimulatorLost):
    """A request could not be sent: the stream has ended."""
