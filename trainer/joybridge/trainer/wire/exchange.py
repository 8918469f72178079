"""The content of a session's messages: requests from arrays, arrays from responses, and what a client waits for."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple, NoReturn

from joybridge.contract.codec import ActArrays, Codec, Format, StepArrays, fill_act
from joybridge.contract.tensors import Array, TensorError
from joybridge.trainer.wire.errors import SimulatorError, SimulatorLost
from joybridge.v1 import bridge_pb2 as pb

__all__ = ["Outcome", "Reader", "Wait", "act_request"]


PATIENCE = 4  # times the deadline: until the first step has come


class Outcome(NamedTuple):
    """What followed a decision."""

    steps: list[StepArrays]  # one per behavior
    simulate_seconds: float  # that the game itself took
    pictures: list[Array]  # of the arenas that were to be drawn, uint8 [height, width, 3] each


class Reader:
    """Checks and unpacks the responses of one session."""

    def __init__(self, address: str, spec: pb.GameSpec, arenas: int) -> None:
        """Prepare for `arenas` of the game that `spec` describes."""
        self._address, self._spec = address, spec
        self._codecs = [Codec(behavior, arenas, len(spec.parameters)) for behavior in spec.behaviors]
        picture = spec.picture
        self._picture = Format(pb.DTYPE_UINT8, (picture.height, picture.width, 3), "step.pictures")

    def started(self, response: pb.PlayResponse) -> Outcome:
        """Return the first observations. Raises SimulatorError."""
        started = self.require(response, "started").started
        if started.spec != self._spec:
            raise SimulatorError(
                f"the simulator at {self._address} sent two different specs of {self._spec.name}, for DescribeGame and "
                "for Start"
            )
        return self._unpack(started.step)

    def step(self, response: pb.PlayResponse, pictures: int = 0) -> Outcome:
        """Return what followed a decision, with so many pictures. Raises SimulatorError."""
        outcome = self._unpack(self.require(response, "step").step)
        if len(outcome.pictures) != pictures:
            raise SimulatorError(
                f"the simulator at {self._address} sent {len(outcome.pictures)} pictures, expected {pictures}"
            )
        return outcome

    def require(self, response: pb.PlayResponse, wanted: str) -> pb.PlayResponse:
        """Return the response if it is of the wanted kind. Raises SimulatorError."""
        received = response.WhichOneof("response")
        if received != wanted:
            raise SimulatorError(f"the simulator at {self._address} answered with {received}, expected {wanted}")
        return response

    def refuse(self, problem: str) -> NoReturn:
        """Raise SimulatorError for a response that breaks the contract."""
        raise SimulatorError(f"the simulator at {self._address} broke the contract: {problem}")

    def _unpack(self, step: pb.Step) -> Outcome:
        messages, codecs = step.behaviors, self._codecs
        try:
            if len(messages) != len(codecs):
                raise TensorError(f"step.behaviors has {len(messages)} entries, expected {len(codecs)}")
            steps = [codec.unpack_step(message) for codec, message in zip(codecs, messages, strict=True)]
            pictures = [self._picture.unpack(tensor) for tensor in step.pictures]
        except TensorError as error:
            self.refuse(str(error))
        return Outcome(steps, step.simulate_seconds, pictures)


class Wait:
    """What a session waits for, and how long at most."""

    def __init__(self, address: str, place: str, seconds: float) -> None:
        """Begin before the first request. place: the game and its arenas."""
        self.address, self.place, self._seconds = address, place, seconds
        self._steps = 0
        self._kind: str | None = None

    @property
    def seconds(self) -> float:
        """Seconds to wait for a response: PATIENCE times as long until the first step, as games may be compiled."""
        return self._seconds * PATIENCE if self._steps <= 1 else self._seconds

    def note(self, request: pb.PlayRequest) -> None:
        """Note which request is sent."""
        self._kind = request.WhichOneof("request")
        self._steps += self._kind == "act"

    def surplus(self) -> SimulatorError:
        """Return the error for a response without a request."""
        return SimulatorError(
            f"the simulator at {self.address} sent a response without a request ({self.place}, step {self._steps}); a "
            "server answers each request once"
        )

    def too_late(self) -> SimulatorLost:
        """Return the error for a response that did not come in time."""
        return SimulatorLost(
            f"the simulator at {self.address} has not answered for {self.seconds:g} s: {self.place}, step "
            f"{self._steps}, waiting for the answer to {self._kind}; look at its log, or allow more time with --timeout"
        )


def act_request(
    acts: Sequence[ActArrays], draw: Sequence[int] = (), distributions: Mapping[str, pb.Distribution] | None = None
) -> pb.PlayRequest:
    """Return the request for one timestep, with pictures of the arenas in `draw`, and new distributions."""
    request = pb.PlayRequest(act=pb.Act(draw=draw, distributions=distributions))
    for act in acts:
        fill_act(request.act.behaviors.add(), act)
    return request
