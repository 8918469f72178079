"""The trainer's end of joybridge.v1: connect to a simulator, open sessions, exchange acts for steps.

SimulatorError            a simulator refused or failed; the text is its sentence
└── SimulatorLost         it went away; the run can be resumed once it is back
"""

import asyncio
from collections.abc import Callable, Coroutine, Mapping, Sequence
from contextlib import suppress
from types import TracebackType
from typing import Any, Self, TypeVar

import grpc

from joybridge.contract.codec import ActArrays, Codec, StepArrays, fill_act
from joybridge.contract.errors import JoybridgeError
from joybridge.contract.spec import MAX_PICTURES, SpecError, check_spec, response_bytes
from joybridge.contract.tensors import Array, Format, TensorError
from joybridge.trainer.wire.event_loop import finish, run, the_loop
from joybridge.v1 import bridge_pb2 as pb
from joybridge.v1 import bridge_pb2_grpc as rpc

CALL_SECONDS = 30.0  # deadline of the unary calls
OPENINGS = 10  # attempts to begin a session
_LOST = (grpc.StatusCode.UNAVAILABLE, grpc.StatusCode.CANCELLED, grpc.StatusCode.DEADLINE_EXCEEDED)
# To notice a machine that is gone without a word. Servers drop who asks more often than every five minutes, by default.
_KEEPALIVE = [("grpc.keepalive_time_ms", 330_000), ("grpc.keepalive_timeout_ms", 20_000)]

T = TypeVar("T")


class SimulatorError(JoybridgeError):
    """A simulator refused a request, failed, or sent something that breaks the contract."""


class SimulatorLost(SimulatorError):
    """A simulator cannot be reached or went away."""


class _Unsent(SimulatorLost):
    """A request could not be sent: the stream has ended."""


def wait_for(address: str, seconds: float, say: Callable[[str], None]) -> None:
    """Wait until a simulator answers at `address`, saying so once. Raises SimulatorLost after `seconds`."""

    async def ready(seconds: float) -> None:
        async with grpc.aio.insecure_channel(address) as channel:
            await asyncio.wait_for(channel.channel_ready(), seconds)

    try:
        try:
            run(ready(min(1.0, seconds)))
        except TimeoutError:
            say(f"waiting up to {seconds:g} s for a simulator at {address} …")
            run(ready(max(0.0, seconds - 1.0)))
    except TimeoutError:
        raise SimulatorLost(
            f"no simulator at {address} after {seconds:g} s; start one there with "
            f"`joybridge serve --address {address}`, or check the address"
        ) from None


def describe(address: str, game: str, options: Mapping[str, str]) -> pb.GameSpec:
    """Return a game's spec, checked. Raises SimulatorError."""

    async def ask() -> pb.GameSpec:
        async with grpc.aio.insecure_channel(address) as channel:
            request = pb.DescribeGameRequest(game=game, options=options)
            answer: pb.DescribeGameResponse = await rpc.SimulatorServiceStub(channel).DescribeGame(
                request, timeout=CALL_SECONDS
            )
            return answer.spec

    try:
        spec = run(ask())
        check_spec(spec)
    except grpc.RpcError as error:
        raise _explain(error, address) from error
    except SpecError as error:
        raise SimulatorError(f"the simulator at {address} sent a spec that breaks the contract: {error}") from error
    return spec


class Session:
    """One Play stream: arenas of one game at one simulator."""

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
        """Open a session; `steps` then holds the first observations, one StepArrays per behavior.

        Raises SimulatorError where the simulator refuses, SimulatorLost where it cannot be reached.
        """
        self.address = address
        self.spec = describe(address, game, options or {})
        self.arenas = arenas
        self._codecs = [Codec(behavior, arenas) for behavior in self.spec.behaviors]
        self.simulate_seconds = 0.0  # the game's own time in the last step
        limit = response_bytes(self.spec, arenas, MAX_PICTURES if self.spec.HasField("picture") else 0)
        lengths = [("grpc.max_receive_message_length", limit), ("grpc.max_send_message_length", -1)]
        self._pending: asyncio.Task[pb.PlayResponse] | None = None  # the answer to what was sent
        self._failure: SimulatorError | None = None  # what ended the session
        self._channel: Any = None
        start = pb.Start(
            game=game, options=options or {}, parameters=parameters or {}, arenas=arenas, seed=seed,
            first_arena=first_arena, snapshot=pb.Snapshot(parts=snapshot) if snapshot is not None else None,
        )  # fmt: skip
        try:
            started = self._begin(pb.PlayRequest(start=start), _KEEPALIVE + lengths).started
            if started.spec != self.spec:
                raise SimulatorError(f"the simulator at {address} changed the spec of {game} between two calls")
            self.steps = self._unpack(started.step)
        except BaseException:
            self.close()
            raise

    def send(self, acts: Sequence[ActArrays], draw: Sequence[int] = ()) -> None:
        """Send the actions of one decision without waiting for the step; `receive` returns it."""
        if self._failure is None:  # else receiving says why
            self._run(self._send(_act(acts, draw)))

    def receive(self) -> list[StepArrays]:
        """Wait for the step of the last `send`; it is also kept in `steps`. Raises SimulatorError."""
        return self._take(self._answer(self._wait(), "step").step)

    def step(self, acts: Sequence[ActArrays]) -> list[StepArrays]:
        """Advance every arena by one decision. Raises SimulatorError."""
        return self._take(self._exchange(_act(acts), "step").step)

    def step_and_draw(self, acts: Sequence[ActArrays], draw: Sequence[int]) -> tuple[list[StepArrays], list[Array]]:
        """Advance every arena by one decision; also return pictures, uint8 [height, width, 3], of some arenas."""
        step = self._exchange(_act(acts, draw), "step").step
        self._take(step)
        size = (self.spec.picture.height, self.spec.picture.width, 3)
        picture = Format(pb.DTYPE_UINT8, size, "step.pictures")
        return self.steps, [picture.unpack(tensor) for tensor in step.pictures]

    def reset(self, seed: int | None = None, parameters: Mapping[str, float] | None = None) -> list[StepArrays]:
        """Begin new episodes everywhere. Raises SimulatorError."""
        request = pb.PlayRequest(reset=pb.Reset(seed=seed, parameters=parameters or {}))
        self.steps = self._unpack(self._exchange(request, "step").step)
        return self.steps

    def save(self) -> dict[str, bytes]:
        """Return a snapshot of the arenas. Raises SimulatorError where the game has none."""
        return dict(self._exchange(pb.PlayRequest(save=pb.Save()), "snapshot").snapshot.parts)

    def close(self) -> None:
        """End the session; the simulator frees its arenas."""
        self._failure = self._failure or SimulatorLost(f"the session at {self.address} is closed")
        if self._channel is not None and not the_loop().is_closed():
            finish(self._close())

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _begin(self, start: pb.PlayRequest, options: list[tuple[str, int]]) -> pb.PlayResponse:
        """Open the stream and return the answer to the first request.

        A server may refuse a stream before it reads from it. gRPC then tells either why, or only that nothing
        could be sent; so ask again.
        """
        for _ in range(OPENINGS):
            self._run(self._open(options))
            with suppress(_Unsent):
                return self._exchange(start, "started")
            self.close()
        raise SimulatorLost(f"the simulator at {self.address} refuses every session, and does not say why")

    async def _open(self, options: list[tuple[str, int]]) -> None:
        self._failure = None
        self._pending = None
        self._channel = grpc.aio.insecure_channel(self.address, options=options)
        self._call = rpc.SimulatorServiceStub(self._channel).Play()

    async def _send(self, request: pb.PlayRequest) -> None:
        """Send a request, and begin to wait for its answer."""
        self._pending = asyncio.create_task(self._ask(request))
        await asyncio.sleep(0)

    async def _ask(self, request: pb.PlayRequest) -> pb.PlayResponse:
        try:
            await self._call.write(request)
        except asyncio.InvalidStateError:  # the session is over: reading says why
            pass
        except grpc.RpcError as error:
            raise _Unsent(f"lost the simulator at {self.address}: it went away") from error
        response: pb.PlayResponse = await self._call.read()
        return response

    async def _wait(self) -> pb.PlayResponse:
        if self._pending is None:  # nothing was asked: what comes is the end
            end: pb.PlayResponse = await self._call.read()
            return end
        pending, self._pending = self._pending, None
        return await pending

    async def _close(self) -> None:
        if self._pending is not None:
            self._pending.cancel()
            with suppress(asyncio.CancelledError, grpc.RpcError, _Unsent):
                await self._pending
        self._call.cancel()
        await self._channel.close()

    def _exchange(self, request: pb.PlayRequest, wanted: str) -> pb.PlayResponse:
        return self._answer(self._ask(request), wanted)

    def _answer(self, coming: Coroutine[Any, Any, pb.PlayResponse], wanted: str) -> pb.PlayResponse:
        """Wait for a response and check that it is the one that is wanted.

        Raises SimulatorError. What ended the session is raised again whenever more is wanted of it.
        """
        if self._failure is not None:
            coming.close()
            raise self._failure
        try:
            response = self._run(coming)
            if response is grpc.aio.EOF:
                raise SimulatorLost(f"the simulator at {self.address} ended the session")
        except grpc.RpcError as error:
            self._failure = _explain(error, self.address)
            raise self._failure from error
        except SimulatorLost as error:
            self._failure = error
            raise
        if response.WhichOneof("response") != wanted:
            came = response.WhichOneof("response")
            raise SimulatorError(f"the simulator at {self.address} answered with {came}, expected {wanted}")
        return response

    def _run(self, work: Coroutine[Any, Any, T]) -> T:
        try:
            return run(work)
        except KeyboardInterrupt:
            self._failure = SimulatorLost(f"the session at {self.address} was interrupted")
            raise

    def _take(self, step: pb.Step) -> list[StepArrays]:
        """Keep what followed a decision."""
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


def _act(acts: Sequence[ActArrays], draw: Sequence[int] = ()) -> pb.PlayRequest:
    request = pb.PlayRequest(act=pb.Act(draw=draw))
    for act in acts:
        fill_act(request.act.behaviors.add(), act)
    return request


def _explain(error: Any, address: str) -> SimulatorError:
    """Return our error for a gRPC one."""
    code, text = error.code(), error.details()
    if code in _LOST:
        return SimulatorLost(f"lost the simulator at {address}: {text} ({code.name})")
    return SimulatorError(f"the simulator at {address} says: {text} ({code.name})")
