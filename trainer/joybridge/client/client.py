"""A trainer's client of joybridge.v1: sessions, and from `calls.py` what finds a simulator and reads a game's spec.

All functions block. The event loop of the sessions runs inside them (see interruptible_loop.py). The address of a
simulator that demands TLS or a token is a ProtectedAddress.
"""

import logging
import socket
import time
import weakref
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Literal, Self, TypeAlias, TypeVar, TypeVarTuple

import numpy as np

from joybridge.client.calls import CALL_SECONDS, describe, description_of, list_games, wait_for
from joybridge.client.demonstration_log import DemonstrationLog
from joybridge.client.errors import SimulatorError, SimulatorLost, SimulatorShutDown
from joybridge.client.fault_log import FaultLog
from joybridge.client.interruptible_loop import EVENT_LOOP
from joybridge.client.local_stream import LocalStream
from joybridge.client.responses import Outcome, Reader
from joybridge.client.stream import ClientStream
from joybridge.config.metrics import metrics_name
from joybridge.contract.address import is_local
from joybridge.contract.codec import ActArrays, StepArrays, fill_act
from joybridge.contract.limits import max_pictures, response_bytes
from joybridge.contract.tensors import Array
from joybridge.contract.text import printable
from joybridge.contract.versions import client_version
from joybridge.v1 import bridge_pb2 as pb

__all__ = ["Session", "SimulatorError", "SimulatorLost", "describe", "list_games", "wait_for"]

log = logging.getLogger("joybridge.trainer")

Distributions: TypeAlias = Mapping[str, pb.Distribution]
Transport: TypeAlias = Literal["auto", "local", "grpc"]

Arguments = TypeVarTuple("Arguments")
T = TypeVar("T")


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
        distributions: Distributions | None = None,
        snapshot: Mapping[str, bytes] | None = None,
        timeout: float = CALL_SECONDS,
        transport: Transport = "auto",
    ) -> None:
        """Open a session, new or from a snapshot.

        distributions: parameter name -> how it is drawn at each episode; see PARAMETERS PER EPISODE in bridge.proto.
        timeout: seconds to wait for each answer. transport: "local" exchanges the messages over a Unix socket, "grpc"
        over the stream; "auto" is "local" where the simulator offers it.

        Raises SimulatorLost if the simulator cannot be reached, SimulatorError if it refuses the session or transport.
        """
        self.address = address
        self.arenas = arenas
        described = description_of(address, game, options or {})
        self.spec = described.spec
        self.simulate_seconds = 0.0
        self.waited = 0.0  # seconds in `receive`
        self._failure: SimulatorError | None = None  # why the session has ended
        self._log: FaultLog | DemonstrationLog | None = None
        self._reader = Reader(address, self.spec, arenas, first_arena, timeout)
        self._coming: Distributions = {}  # for the next Act
        self._drawn = set(distributions or ())  # the parameters that are
        self._largest = response_bytes(self.spec, arenas, max_pictures(self.spec))
        self._revision = described.version.revision
        stream = ClientStream(self._reader, self._largest, self._revision)
        self._use(stream)
        self._start = pb.Start(
            game=game,
            options=options or {},
            parameters=parameters or {},
            arenas=arenas,
            seed=seed,
            distributions=distributions or {},
            first_arena=first_arena,
            snapshot=pb.Snapshot(parts=snapshot) if snapshot is not None else None,
            version=client_version(),
        )
        try:
            response = self._run(self._open, stream, self._start, transport)
            self.steps = self._reader.started(response).steps
            self.server = printable(response.started.version.product)  # for people
        except BaseException:
            self.close()
            raise

    def send(self, acts: Sequence[ActArrays]) -> None:
        """Send the actions of one timestep, one ActArrays per behavior, without waiting; `receive` returns the step.

        Raises SimulatorError.
        """
        self._run(self._send, acts)

    def receive(self) -> list[StepArrays]:
        """Wait for the step after the last `send` and return it. Raises SimulatorError."""
        begin = time.perf_counter()
        steps = self._run(self._receive, self._stream.receive).steps
        self.waited += time.perf_counter() - begin
        return steps

    def step(self, acts: Sequence[ActArrays]) -> list[StepArrays]:
        """Advance every arena by one timestep and return the step. Raises SimulatorError."""
        return self._run(self._ask, self._act(acts)).steps

    def step_and_draw(self, acts: Sequence[ActArrays], draw: Sequence[int]) -> tuple[list[StepArrays], list[Array]]:
        """Like `step`; also return pictures of some arenas, uint8 [height, width, 3] each. Raises SimulatorError."""
        outcome = self._run(self._ask, self._act(acts, draw), len(draw))
        return outcome.steps, outcome.pictures

    def step_and_draw_ticks(self, acts: Sequence[ActArrays]) -> tuple[list[StepArrays], list[Array]]:
        """Like `step`; also return what the first arena has shown after each tick, the last one at the end.

        That is one picture where the game, or an older simulator, draws decisions only, or where pictures of all ticks
        would be too many for a message. Raises SimulatorError.
        """
        request = self._act(acts, [0])
        if max_pictures(self.spec) >= self.spec.decision_interval > 1:
            request.act.draw_ticks = 0
        outcome = self._run(self._ask, request, 1)
        return outcome.steps, outcome.tick_pictures + outcome.pictures

    def distribute(self, distributions: Distributions) -> None:
        """Draw these parameters in all episodes that begin from the next step on; running ones keep theirs."""
        self._coming = {**self._coming, **distributions}

    def reset(self, seed: int | None = None, parameters: Mapping[str, float] | None = None) -> list[StepArrays]:
        """Begin new episodes in all arenas and return their first observations. Raises SimulatorError."""
        self._drawn.difference_update(parameters or ())  # a value ends the distribution of its parameter
        return self._run(self._ask, pb.PlayRequest(reset=pb.Reset(seed=seed, parameters=parameters or {}))).steps

    def failed_arenas(self) -> list[int]:
        """Return the arenas of this session whose game failed in the last step, and that the simulator made again."""
        lanes = [
            step.ended[step.interrupted] // behavior.agents_per_arena
            for behavior, step in zip(self.spec.behaviors, self.steps, strict=True)
            if step.interrupted is not None
        ]
        return np.unique(np.concatenate(lanes)).tolist() if lanes else []

    def save(self) -> dict[str, bytes]:
        """Return a snapshot of all arenas. Raises SimulatorError if the game does not support snapshots."""
        response = self._run(self._stream.ask, pb.PlayRequest(save=pb.Save()))
        parts = dict(self._reader.require(response, "snapshot").snapshot.parts)
        if self._log is not None:
            self._log.saved(parts)
        return parts

    def repeat(self, request: pb.PlayRequest) -> list[StepArrays]:
        """Send an Act or Reset of another session, and return the step that answers it. Raises SimulatorError."""
        self._drawn.update(request.act.distributions, request.reset.distributions)
        self._drawn.difference_update(request.reset.parameters)
        return self._run(self._ask, request, len(request.act.draw)).steps

    def record_faults(self, folder: Path) -> None:
        """Write what led to an error of the simulator into a file of this folder, from now on; see FaultLog.

        Call this before the first request. The name of the file has the game's and the numbers of the arenas.
        """
        game, first = metrics_name(self._start.game), self._start.first_arena
        path = folder / f"{game}-{first}-{first + self.arenas - 1}.fault"
        self._log = FaultLog(path, self._start, self.server, self.steps)

    def write_fault(self, error: str) -> None:
        """Write what led to the present step into the file of `record_faults`, for an error of the caller's own."""
        if self._log is not None:
            self._log.failed(error)

    def record_demonstration(self, folder: Path) -> DemonstrationLog:
        """Write what is played from now on into a new file of this folder; see DemonstrationLog. Raises StorageError.

        Call this before the first request, and not with `record_faults`.
        """
        self._log = recorded = DemonstrationLog(folder, self._start, self.server, self.spec, self.steps)
        return recorded

    def close(self) -> None:
        """End the session; the simulator frees its arenas. May be called again, and by finalizers."""
        self._failure = self._failure or SimulatorLost(f"the session at {self.address} is closed")
        self._end_stream()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _open(self, stream: ClientStream, start: pb.Start, transport: Transport) -> pb.PlayResponse:
        """Open the session and return its first response. Raises SimulatorError."""
        start.local_transport = transport != "grpc" and is_local(self.address) and hasattr(socket, "AF_UNIX")
        response = stream.open(start)
        path = response.started.local_socket if start.local_transport else ""
        problem = "the simulator does not offer it"
        if path:
            try:
                # On the event loop, which holds back interrupts: one that came meanwhile would lose an open socket.
                local = EVENT_LOOP.run(_open_local, stream, self._reader, path, self._largest)
                end_stream = self._end_stream
                self._use(local)
                end_stream.detach()  # last: an interrupt before it leaves somebody who ends the stream
                return response
            except (OSError, ValueError) as error:  # ValueError: a path with a zero byte
                problem = str(error)
        if transport == "local":
            raise SimulatorError(f"no local transport to {self.address}: {problem}; leave it to transport=auto")
        if path:
            self._end_stream()
            stream = ClientStream(self._reader, self._largest, self._revision)
            self._use(stream)
            return self._open(stream, start, "grpc")
        return response

    def _use(self, stream: ClientStream | LocalStream) -> None:
        """Send requests over this stream. The event loop keeps it, so a session that nobody refers to must end it."""
        self._stream = stream
        self._end_stream = weakref.finalize(self, stream.close)
        self._end_stream.atexit = False

    def _act(self, acts: Sequence[ActArrays], draw: Sequence[int] = ()) -> pb.PlayRequest:
        """Return the request for one timestep, with pictures of the arenas in `draw`."""
        coming, self._coming = self._coming, {}
        self._drawn.update(coming)
        request = pb.PlayRequest(act=pb.Act(draw=draw, distributions=coming))
        for act in acts:
            fill_act(request.act.behaviors.add(), act)
        return request

    def _send(self, acts: Sequence[ActArrays]) -> None:
        request = self._act(acts)
        if self._log is not None:
            self._log.sent(request)
        self._stream.send(request)

    def _ask(self, request: pb.PlayRequest, pictures: int = 0) -> Outcome:
        """Send a request and return the step that answers it, with so many pictures. Raises SimulatorError."""
        if self._log is not None:
            self._log.sent(request)
        return self._receive(partial(self._stream.ask, request), pictures)

    def _receive(self, response: Callable[[], pb.PlayResponse], pictures: int = 0) -> Outcome:
        """Return the step in a response, with so many pictures. Raises SimulatorError."""
        outcome = self._reader.step(response(), pictures)
        self.steps, self.simulate_seconds = outcome.steps, outcome.simulate_seconds
        if self._drawn and any(len(step.ended) and step.parameters is None for step in self.steps):
            self._reader.refuse("ended.parameters is missing, though parameters have distributions")
        if self._log is not None:
            self._log.came(self.steps)
        if any(step.interrupted is not None for step in self.steps):
            failed = [self._start.first_arena + arena for arena in self.failed_arenas()]  # their numbers in its log
            text = f"{self.spec.name} failed at {self.address} in arenas {failed}, whose episodes are cut"
            log.warning("%s and count as no results; see the simulator's log", text)
            self.write_fault(text)
        return outcome

    def _run(self, function: Callable[[*Arguments], T], *args: *Arguments) -> T:
        """Call a function. An error or an interrupt in it ends the session; later calls raise that error again."""
        if self._failure is not None:
            raise self._failure
        try:
            return function(*args)
        except SimulatorError as error:
            self._failure = error
            if not isinstance(error, SimulatorShutDown):
                self.write_fault(str(error))
            raise
        except KeyboardInterrupt:
            self._failure = SimulatorLost(f"the session at {self.address} was interrupted")
            raise


async def _open_local(stream: ClientStream, reader: Reader, path: str, largest: int) -> LocalStream:
    return LocalStream(stream, reader, path, largest)
