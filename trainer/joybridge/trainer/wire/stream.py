"""One Play stream over gRPC: actions out, steps in, in turns. Its methods run on the event loop."""

import asyncio
import math
from collections.abc import Awaitable, Sequence
from contextlib import suppress
from typing import Any, NamedTuple, TypeVar

import grpc
from google.protobuf.message import DecodeError, Message

from joybridge.contract.codec import ActArrays, Codec, Format, StepArrays, fill_act
from joybridge.contract.credentials import credentials_of
from joybridge.contract.limits import max_pictures, response_bytes
from joybridge.contract.tensors import Array, TensorError
from joybridge.trainer.wire.errors import SimulatorError, SimulatorLost, from_grpc
from joybridge.v1 import bridge_pb2 as pb

ATTEMPTS = 10  # to open a stream
PAUSE_SECONDS = 0.002  # between two calls, after which the end of the stream may have come
SERVICE = pb.DESCRIPTOR.services_by_name["SimulatorService"].full_name
# Pings detect a machine that has disappeared. By default, gRPC servers end connections that ping more often than
# every five minutes.
KEEPALIVE = [("grpc.keepalive_time_ms", 330_000), ("grpc.keepalive_timeout_ms", 20_000)]

M = TypeVar("M", bound=Message)


class Outcome(NamedTuple):
    """What followed a decision."""

    steps: list[StepArrays]  # one per behavior
    simulate_seconds: float  # that the game itself took
    pictures: list[Array]  # of the arenas that were to be drawn, uint8 [height, width, 3] each


class Stream:
    """A Play stream to the simulator at an address, for `arenas` of the game that `spec` describes."""

    def __init__(self, address: str, spec: pb.GameSpec, arenas: int, seconds: float) -> None:
        """Prepare a stream. seconds: how long to wait for each response."""
        self.address, self._spec, self._seconds = address, spec, seconds
        self._place = f"{spec.name}, {arenas} arenas"  # for errors
        self._steps = 0
        self._late = False  # whether a response did not come in time
        self._heard = math.inf  # when the last response came, in the time of the loop
        self._codecs = [Codec(behavior, arenas) for behavior in spec.behaviors]
        picture = spec.picture
        self._picture = Format(pb.DTYPE_UINT8, (picture.height, picture.width, 3), "step.pictures")
        self._options = [
            ("grpc.max_receive_message_length", response_bytes(spec, arenas, max_pictures(spec))),
            ("grpc.max_send_message_length", -1),
            *KEEPALIVE,
        ]
        self._channel: Any = None
        self._call: Any = None
        self._pending: asyncio.Task[pb.PlayResponse] | None = None  # the response to the last `send`
        self._listening: asyncio.Task[None] | None = None  # reads the responses; asyncio references tasks weakly
        self._awaited: asyncio.Future[bytes] | None = None  # the response to the last request, until it has come
        self._ended: SimulatorError | None = None  # why no further response is read

    async def open(self, start: pb.Start) -> Outcome:
        """Open the stream, start the session and return its first observations. Raises SimulatorError.

        A server may reject a stream before it reads the request. gRPC then reports either the server's reason, or only
        that the request could not be sent. In the second case, try again.
        """
        credentials = credentials_of(self.address)
        for _ in range(ATTEMPTS):
            self._channel = credentials.aio_channel(self.address, self._options)
            play = self._channel.stream_stream(f"/{SERVICE}/Play", pb.PlayRequest.SerializeToString)
            self._call = play(metadata=credentials.metadata)
            self._listening = asyncio.create_task(self._listen(self._call))
            self._place = f"{start.game}, arenas {start.first_arena} to {start.first_arena + start.arenas - 1}"
            try:
                response = await self._wait(self._exchange(pb.PlayRequest(start=start)))
                break
            except _NotSent:
                await self.close()
        else:
            raise SimulatorLost(
                f"the simulator at {self.address} rejected the session {ATTEMPTS} times without a reason; see its log"
            )
        started = self._require(response, "started").started
        if started.spec != self._spec:
            raise SimulatorError(
                f"the simulator at {self.address} sent two different specs of {start.game}, for DescribeGame and for "
                "Start"
            )
        return self._unpack(started.step)

    async def send(self, acts: Sequence[ActArrays]) -> None:
        """Send the actions of one timestep without waiting for the step; `receive` returns it."""
        await self._prepare()
        self._pending = asyncio.create_task(self._exchange(_act_request(acts)))
        await asyncio.sleep(0)  # lets the task begin to send

    async def receive(self) -> Outcome:
        """Return what followed the last `send`. Raises SimulatorError."""
        if self._pending is None:
            raise SimulatorError("receive() without send(): no response is on its way")
        pending, self._pending = self._pending, None
        return self._unpack(self._require(await self._wait(pending), "step").step)

    async def step(self, acts: Sequence[ActArrays], draw: Sequence[int] = ()) -> Outcome:
        """Send the actions of one timestep and return what followed, with pictures of the arenas in `draw`.

        Raises SimulatorError.
        """
        await self._prepare()
        response = await self._wait(self._exchange(_act_request(acts, draw)))
        outcome = self._unpack(self._require(response, "step").step)
        if len(outcome.pictures) != len(draw):
            raise SimulatorError(
                f"the simulator at {self.address} sent {len(outcome.pictures)} pictures, expected {len(draw)}"
            )
        return outcome

    async def reset(self, reset: pb.Reset) -> Outcome:
        """Begin new episodes and return their first observations. Raises SimulatorError."""
        await self._prepare()
        response = await self._wait(self._exchange(pb.PlayRequest(reset=reset)))
        return self._unpack(self._require(response, "step").step)

    async def save(self) -> dict[str, bytes]:
        """Return a snapshot of all arenas. Raises SimulatorError."""
        await self._prepare()
        response = await self._wait(self._exchange(pb.PlayRequest(save=pb.Save())))
        return dict(self._require(response, "snapshot").snapshot.parts)

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
            for _ in range(3):  # for the socket, the queue of gRPC and the task that takes the status
                await asyncio.sleep(0)

    async def _wait(self, response: Awaitable[pb.PlayResponse]) -> pb.PlayResponse:
        """Return a response. Raises SimulatorLost if it does not come in time.

        The time begins with the wait, not with the request: a caller may do something else in between. A timer is
        cheaper than asyncio's timeouts. It cancels the wait, not the call: a call that is cancelled before it has begun
        leaves gRPC waiting for ever.
        """
        loop = asyncio.get_running_loop()
        timer = loop.call_later(self._seconds, self._give_up, asyncio.current_task())
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
        kind = request.WhichOneof("request")
        self._steps += kind == "act"
        if self._ended is not None:
            raise self._ended
        self._awaited = awaited = asyncio.get_running_loop().create_future()
        try:
            with suppress(
                asyncio.InvalidStateError
            ):  # the stream has ended; waiting for the response raises the reason
                await self._call.write(request)
            data = await awaited
        except asyncio.CancelledError:
            raise self._too_late(kind) from None
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
                self._ended = self._ended or SimulatorError(
                    f"the simulator at {self.address} sent a response without a request ({self._place}, step "
                    f"{self._steps}); a server answers each request once"
                )
            elif self._ended is not None:
                awaited.set_exception(self._ended)
            else:
                awaited.set_result(data)

    def _too_late(self, kind: str | None) -> BaseException:
        """Return the error for a wait that was cancelled: by its timer, or by an interrupt."""
        if not self._late:
            return asyncio.CancelledError()
        return SimulatorLost(
            f"the simulator at {self.address} has not answered for {self._seconds:g} s: {self._place}, step "
            f"{self._steps}, waiting for the answer to {kind}; look at its log, or allow more time with --timeout"
        )

    def _require(self, response: pb.PlayResponse, wanted: str) -> pb.PlayResponse:
        """Return the response if it is of the wanted kind. Raises SimulatorError."""
        received = response.WhichOneof("response")
        if received != wanted:
            raise SimulatorError(f"the simulator at {self.address} answered with {received}, expected {wanted}")
        return response

    def _unpack(self, step: pb.Step) -> Outcome:
        messages, codecs = step.behaviors, self._codecs
        try:
            if len(messages) != len(codecs):
                raise TensorError(f"step.behaviors has {len(messages)} entries, expected {len(codecs)}")
            steps = [codec.unpack_step(message) for codec, message in zip(codecs, messages, strict=True)]
            pictures = [self._picture.unpack(tensor) for tensor in step.pictures]
        except TensorError as error:
            raise SimulatorError(f"the simulator at {self.address} broke the contract: {error}") from error
        return Outcome(steps, step.simulate_seconds, pictures)


def parse(kind: type[M], data: bytes, address: str) -> M:
    """Return the message in a response. Raises SimulatorError.

    gRPC's own deserialization would log a traceback and return None for what cannot be parsed.
    """
    try:
        return kind.FromString(data)
    except DecodeError as error:
        raise SimulatorError(
            f"the simulator at {address} sent what is no {kind.DESCRIPTOR.name}: {error}; check its version"
        ) from error


def _act_request(acts: Sequence[ActArrays], draw: Sequence[int] = ()) -> pb.PlayRequest:
    request = pb.PlayRequest(act=pb.Act(draw=draw))
    for act in acts:
        fill_act(request.act.behaviors.add(), act)
    return request


class _NotSent(SimulatorLost):
    """A request could not be sent: the stream has ended."""
