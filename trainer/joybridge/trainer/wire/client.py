"""A trainer's client of joybridge.v1: find a simulator, read a game's spec, play a session.

All functions block. The event loop of the sessions runs inside them (see interruptible_loop.py).
"""

import asyncio
from collections.abc import Callable, Coroutine, Mapping, Sequence
from types import TracebackType
from typing import Any, Self, TypeVar, TypeVarTuple

import grpc

from joybridge.contract.codec import ActArrays, Codec, StepArrays, fill_act
from joybridge.contract.limits import MAX_PICTURES, response_bytes
from joybridge.contract.spec import SpecError, check_spec
from joybridge.contract.tensors import Array, Format, TensorError
from joybridge.contract.versions import mismatch, own_version
from joybridge.trainer.wire.errors import SimulatorError, SimulatorLost, from_grpc
from joybridge.trainer.wire.interruptible_loop import EVENT_LOOP
from joybridge.trainer.wire.reachability import why_unreachable
from joybridge.trainer.wire.stream import Stream
from joybridge.v1 import bridge_pb2 as pb
from joybridge.v1 import bridge_pb2_grpc as rpc

__all__ = ["Session", "SimulatorError", "SimulatorLost", "describe", "wait_for"]

CALL_SECONDS = 30.0  # deadline of DescribeGame

Arguments = TypeVarTuple("Arguments")
T = TypeVar("T")


def wait_for(address: str, seconds: float, say: Callable[[str], None]) -> None:
    """Wait until a simulator can be reached at an address. Raises SimulatorLost after so many seconds.

    say: called once with a message if the wait takes longer than a second.
    """
    try:
        try:
            EVENT_LOOP.run(_connect, address, min(1.0, seconds))
        except TimeoutError:
            say(f"waiting up to {seconds:g} s for a simulator at {address} ({why_unreachable(address)}) …")
            EVENT_LOOP.run(_connect, address, max(0.0, seconds - 1.0))
    except TimeoutError:
        raise SimulatorLost(
            f"no simulator at {address} after {seconds:g} s: {why_unreachable(address)}; start one there with "
            f"`joybridge serve --address {address}`, or check the address"
        ) from None


def describe(address: str, game: str, options: Mapping[str, str]) -> pb.GameSpec:
    """Return the spec of a game with some options.

    Raises SimulatorError if the simulator refuses, sends a spec that breaks the contract, or has an older revision of
    the contract than this client.
    """
    request = pb.DescribeGameRequest(game=game, options=options, version=own_version())
    try:
        response = EVENT_LOOP.run(_describe, address, request)
        if text := mismatch(own_version(), response.version):
            raise SimulatorError(f"{address}: {text}")
        spec = response.spec
        check_spec(spec)
    except grpc.RpcError as error:
        raise from_grpc(error, address) from error
    except SpecError as error:
        raise SimulatorError(f"the simulator at {address} sent a spec that breaks the contract: {error}") from error
    return spec


class Session:
    """Arenas of one game at one simulator, played over one Play stream.

    `spec` describes the game. `steps` holds the last step, one StepArrays per behavior; at first, the first
    observations. `simulate_seconds` is the time that the game itself took for the last step.
    """

    def __init__(
        self,
        address: str,
        game: str,
        *,
        arenas: int,
        seed: int,
        first_arena: int = 0,
        options: Mapping[str, str] | None = None,
        parameters: Mapping[str, float] | None = None,
        snapshot: Mapping[str, bytes] | None = None,
    ) -> None:
        """Open a session, new or from a snapshot.

        Raises SimulatorLost if the simulator cannot be reached, SimulatorError if it refuses the session.
        """
        self.address = address
        self.arenas = arenas
        self.spec = describe(address, game, options or {})
        self.simulate_seconds = 0.0
        self._codecs = [Codec(behavior, arenas) for behavior in self.spec.behaviors]
        self._failure: SimulatorError | None = None  # why the session has ended
        pictures = MAX_PICTURES if self.spec.HasField("picture") else 0
        self._stream = Stream(address, response_bytes(self.spec, arenas, pictures))
        start = pb.Start(
            game=game, options=options or {}, parameters=parameters or {}, arenas=arenas, seed=seed,
            first_arena=first_arena, snapshot=pb.Snapshot(parts=snapshot) if snapshot is not None else None,
            version=own_version(),
        )  # fmt: skip
        try:
            response = self._run(self._stream.open, pb.PlayRequest(start=start))
            started = self._require(response, "started").started
            if started.spec != self.spec:
                raise SimulatorError(
                    f"the simulator at {address} sent two different specs of {game}, for DescribeGame and for Start"
                )
            self.steps = self._unpack(started.step)
        except BaseException:
            self.close()
            raise

    def send(self, acts: Sequence[ActArrays]) -> None:
        """Send the actions of one timestep, one ActArrays per behavior, without waiting; `receive` returns the step.

        Raises SimulatorError.
        """
        self._run(self._stream.send, _act_request(acts))

    def receive(self) -> list[StepArrays]:
        """Wait for the step after the last `send` and return it. Raises SimulatorError."""
        return self._take(self._run(self._stream.receive))

    def step(self, acts: Sequence[ActArrays]) -> list[StepArrays]:
        """Advance every arena by one timestep and return the step. Raises SimulatorError."""
        return self._take(self._exchange(_act_request(acts)))

    def step_and_draw(self, acts: Sequence[ActArrays], draw: Sequence[int]) -> tuple[list[StepArrays], list[Array]]:
        """Like `step`; also return pictures of some arenas, uint8 [height, width, 3] each. Raises SimulatorError."""
        response = self._exchange(_act_request(acts, draw))
        self._take(response)
        shape = (self.spec.picture.height, self.spec.picture.width, 3)
        picture = Format(pb.DTYPE_UINT8, shape, "step.pictures")
        pictures = response.step.pictures
        if len(pictures) != len(draw):
            raise SimulatorError(f"the simulator at {self.address} sent {len(pictures)} pictures, expected {len(draw)}")
        try:
            return self.steps, [picture.unpack(tensor) for tensor in pictures]
        except TensorError as error:
            raise SimulatorError(f"the simulator at {self.address} broke the contract: {error}") from error

    def reset(self, seed: int | None = None, parameters: Mapping[str, float] | None = None) -> list[StepArrays]:
        """Begin new episodes in all arenas and return their first observations. Raises SimulatorError."""
        request = pb.PlayRequest(reset=pb.Reset(seed=seed, parameters=parameters or {}))
        self.steps = self._unpack(self._require(self._exchange(request), "step").step)
        return self.steps

    def save(self) -> dict[str, bytes]:
        """Return a snapshot of all arenas. Raises SimulatorError if the game does not support snapshots."""
        response = self._exchange(pb.PlayRequest(save=pb.Save()))
        return dict(self._require(response, "snapshot").snapshot.parts)

    def close(self) -> None:
        """End the session; the simulator frees its arenas. May be called again, and by finalizers."""
        self._failure = self._failure or SimulatorLost(f"the session at {self.address} is closed")
        EVENT_LOOP.run_soon(self._stream.close)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _exchange(self, request: pb.PlayRequest) -> pb.PlayResponse:
        return self._run(self._stream.exchange, request)

    def _run(self, function: Callable[[*Arguments], Coroutine[Any, Any, T]], *args: *Arguments) -> T:
        """Run a method of the stream. An error or an interrupt ends the session; later calls raise that error again."""
        if self._failure is not None:
            raise self._failure
        try:
            return EVENT_LOOP.run(function, *args)
        except SimulatorError as error:
            self._failure = error
            raise
        except KeyboardInterrupt:
            self._failure = SimulatorLost(f"the session at {self.address} was interrupted")
            raise

    def _require(self, response: pb.PlayResponse, wanted: str) -> pb.PlayResponse:
        """Return the response if it is of the wanted kind. Raises SimulatorError."""
        received = response.WhichOneof("response")
        if received != wanted:
            raise SimulatorError(f"the simulator at {self.address} answered with {received}, expected {wanted}")
        return response

    def _take(self, response: pb.PlayResponse) -> list[StepArrays]:
        """Keep the step after an action and return it."""
        step = self._require(response, "step").step
        self.simulate_seconds = step.simulate_seconds
        self.steps = self._unpack(step)
        return self.steps

    def _unpack(self, step: pb.Step) -> list[StepArrays]:
        messages, codecs = step.behaviors, self._codecs
        try:
            if len(messages) != len(codecs):
                raise TensorError(f"step.behaviors has {len(messages)} entries, expected {len(codecs)}")
            return [codec.unpack_step(message) for codec, message in zip(codecs, messages, strict=True)]
        except TensorError as error:
            raise SimulatorError(f"the simulator at {self.address} broke the contract: {error}") from error


def _act_request(acts: Sequence[ActArrays], draw: Sequence[int] = ()) -> pb.PlayRequest:
    request = pb.PlayRequest(act=pb.Act(draw=draw))
    for act in acts:
        fill_act(request.act.behaviors.add(), act)
    return request


async def _connect(address: str, seconds: float) -> None:
    async with grpc.aio.insecure_channel(address) as channel:
        await asyncio.wait_for(channel.channel_ready(), seconds)


async def _describe(address: str, request: pb.DescribeGameRequest) -> pb.DescribeGameResponse:
    async with grpc.aio.insecure_channel(address) as channel:
        response: pb.DescribeGameResponse = await rpc.SimulatorServiceStub(channel).DescribeGame(
            request, timeout=CALL_SECONDS
        )
        return response
