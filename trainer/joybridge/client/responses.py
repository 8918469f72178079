"""The responses of a session: how long to wait for one, what it holds, and the error if it is wrong or missing."""

import math
from typing import NamedTuple, NoReturn, TypeVar

from google.protobuf.message import DecodeError, Message

from joybridge.client.errors import SimulatorError, SimulatorLost
from joybridge.contract.codec import Codec, Format, StepArrays
from joybridge.contract.tensors import Array, TensorError
from joybridge.v1 import bridge_pb2 as pb

__all__ = ["Outcome", "Reader", "parse"]

PATIENCE = 4  # times the deadline: until the first step has come, as games may be compiled for it

M = TypeVar("M", bound=Message)


class Outcome(NamedTuple):
    """What followed a decision."""

    steps: list[StepArrays]  # one per behavior
    simulate_seconds: float  # that the game itself took
    pictures: list[Array]  # of the arenas that were to be drawn, uint8 [height, width, 3] each
    tick_pictures: list[Array]  # of the arena of which the ticks before the last were to be drawn


class Reader:
    """Checks and unpacks the responses of one session. `seconds` is how long to wait for the next one."""

    def __init__(self, address: str, spec: pb.GameSpec, arenas: int, first_arena: int, seconds: float) -> None:
        """Prepare for `arenas` of the game that `spec` describes. seconds: the deadline of a response."""
        self.address, self.seconds = address, PATIENCE * seconds
        self._spec, self._deadline = spec, seconds
        self._place = f"{spec.name}, arenas {first_arena} to {first_arena + arenas - 1}"
        self._steps = 0
        self._codecs = [Codec(behavior, arenas, len(spec.parameters)) for behavior in spec.behaviors]
        picture = spec.picture
        self._picture = Format(pb.DTYPE_UINT8, (picture.height, picture.width, 3), "step.pictures")

    def started(self, response: pb.PlayResponse) -> Outcome:
        """Return the first observations. Raises SimulatorError."""
        started = self.require(response, "started").started
        if started.spec != self._spec:
            raise SimulatorError(
                f"the simulator at {self.address} sent two different specs of {self._spec.name}, for DescribeGame and "
                "for Start"
            )
        outcome = self._unpack(started.step)
        if any(len(step.ended) or step.rewards.any() for step in outcome.steps):
            self.refuse("episodes end, or rewards are paid, before the first decision")
        return outcome

    def step(self, response: pb.PlayResponse, pictures: int = 0) -> Outcome:
        """Return what followed a decision, with so many pictures. Raises SimulatorError."""
        outcome = self._unpack(self.require(response, "step").step)
        if len(outcome.pictures) != pictures:
            raise SimulatorError(
                f"the simulator at {self.address} sent {len(outcome.pictures)} pictures, expected {pictures}"
            )
        if len(outcome.tick_pictures) >= self._spec.decision_interval:
            self.refuse(f"{len(outcome.tick_pictures)} tick_pictures of {self._spec.decision_interval} ticks")
        self._steps += 1
        self.seconds = self._deadline
        return outcome

    def require(self, response: pb.PlayResponse, wanted: str) -> pb.PlayResponse:
        """Return the response if it is of the wanted kind. Raises SimulatorError."""
        received = response.WhichOneof("response")
        if received != wanted:
            raise SimulatorError(f"the simulator at {self.address} answered with {received}, expected {wanted}")
        return response

    def refuse(self, problem: str) -> NoReturn:
        """Raise SimulatorError for a response that breaks the contract."""
        raise SimulatorError(f"the simulator at {self.address} broke the contract: {problem}")

    def surplus(self) -> SimulatorError:
        """Return the error for a response without a request."""
        return SimulatorError(
            f"the simulator at {self.address} sent a response without a request ({self._place}, after {self._steps} "
            "steps); a server answers each request once"
        )

    def too_late(self, request: pb.PlayRequest) -> SimulatorLost:
        """Return the error for a request whose response did not come in time."""
        return SimulatorLost(
            f"the simulator at {self.address} has not answered for {self.seconds:g} s: {self._place}, after "
            f"{self._steps} steps, waiting for the answer to {request.WhichOneof('request')}; look at its log, or "
            "allow more time with --timeout"
        )

    def _unpack(self, step: pb.Step) -> Outcome:
        messages, codecs = step.behaviors, self._codecs
        try:
            if len(messages) != len(codecs):
                raise TensorError(f"step.behaviors has {len(messages)} entries, expected {len(codecs)}")
            steps = [codec.unpack_step(message) for codec, message in zip(codecs, messages, strict=True)]
            drawn = [[self._picture.unpack(tensor) for tensor in some] for some in (step.pictures, step.tick_pictures)]
        except TensorError as error:
            self.refuse(str(error))
        if not 0 <= step.simulate_seconds < math.inf:
            self.refuse(f"step.simulate_seconds is {step.simulate_seconds}, expected a finite number of at least 0")
        return Outcome(steps, step.simulate_seconds, *drawn)


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
