"""One Play stream over gRPC: actions out, steps in, in turns. Its methods run on the event loop."""

import asyncio
from collections.abc import Sequence
from contextlib import suppress
from typing import Any, NamedTuple

import grpc

from joybridge.contract.codec import ActArrays, Codec, Format, StepArrays, fill_act
from joybridge.contract.limits import max_pictures, response_bytes
from joybridge.contract.tensors import Array, TensorError
from joybridge.trainer.wire.errors import SimulatorError, SimulatorLost, from_grpc
from joybridge.v1 import bridge_pb2 as pb
from joybridge.v1 import bridge_pb2_grpc as rpc

ATTEMPTS = 10  # to open a stream
# Pings detect a machine that has disappeared. By default, gRPC servers end connections that ping more often than
# every five minutes.
KEEPALIVE = [("grpc.keepalive_time_ms", 330_000), ("grpc.keepalive_timeout_ms", 20_000)]


class Outcome(NamedTuple):
    """What followed a decision."""

    steps: list[StepArrays]  # one per behavior
    simulate_seconds: float  # that the game itself took
    pictures: list[Array]  # of the arenas that were to be drawn, uint8 [height, width, 3] each


class Stream:
    """A Play stream to the simulator at an address, for `arenas` of the game that `spec` describes."""

    def __init__(self, address: str, spec: pb.GameSpec, arenas: int) -> None:
        self.address, self._spec = address, spec
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

    async def open(self, start: pb.Start) -> Outcome:
        """Open the stream, start the session and return its first observations. Raises SimulatorError.

        A server may reject a stream before it reads the request. gRPC then reports either the server's reason, or only
        that the request could not be sent. In the second case, try again.
        """
        for _ in range(ATTEMPTS):
            self._channel = grpc.aio.insecure_channel(self.address, options=self._options)
            self._call = rpc.SimulatorServiceStub(self._channel).Play()
            try:
                response = await self._exchange(pb.PlayRequest(start=start))
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
        await self._finish_pending()
        self._pending = asyncio.create_task(self._exchange(_act_request(acts)))
        await asyncio.sleep(0)  # lets the task begin to send

    async def receive(self) -> Outcome:
        """Return what followed the last `send`. Raises SimulatorError."""
        if self._pending is None:
            raise SimulatorError("receive() without send(): no response is on its way")
        pending, self._pending = self._pending, None
        return self._unpack(self._require(await pending, "step").step)

    async def step(self, acts: Sequence[ActArrays], draw: Sequence[int] = ()) -> Outcome:
        """Send the actions of one timestep and return what followed, with pictures of the arenas in `draw`.

        Raises SimulatorError.
        """
        await self._finish_pending()
        response = await self._exchange(_act_request(acts, draw))
        outcome = self._unpack(self._require(response, "step").step)
        if len(outcome.pictures) != len(draw):
            raise SimulatorError(
                f"the simulator at {self.address} sent {len(outcome.pictures)} pictures, expected {len(draw)}"
            )
        return outcome

    async def reset(self, reset: pb.Reset) -> Outcome:
        """Begin new episodes and return their first observations. Raises SimulatorError."""
        await self._finish_pending()
        response = await self._exchange(pb.PlayRequest(reset=reset))
        return self._unpack(self._require(response, "step").step)

    async def save(self) -> dict[str, bytes]:
        """Return a snapshot of all arenas. Raises SimulatorError."""
        await self._finish_pending()
        response = await self._exchange(pb.PlayRequest(save=pb.Save()))
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

    async def _finish_pending(self) -> None:
        """Drop a response that was not received, because an interrupt came after `send`.

        gRPC does not support two reads at a time.
        """
        if self._pending is not None:
            pending, self._pending = self._pending, None
            await pending

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


def _act_request(acts: Sequence[ActArrays], draw: Sequence[int] = ()) -> pb.PlayRequest:
    request = pb.PlayRequest(act=pb.Act(draw=draw))
    for act in acts:
        fill_act(request.act.behaviors.add(), act)
    return request


class _NotSent(SimulatorLost):
    """A request could not be sent: the stream has ended."""
