"""One session: requests in, responses out, and every rule of bridge.proto about their order and content.

Knows nothing of gRPC beyond status codes, so it is tested without a socket.
"""

import logging
import time
from collections.abc import Mapping

import grpc
import numpy as np

from joybridge.codec import StepArrays, pack_step, unpack_act
from joybridge.spec import MAX_PICTURES, SpecError, choose_options, choose_parameters
from joybridge.tensors import TensorError, pack
from joybridge.v1 import bridge_pb2 as pb
from simulator.batch import BatchedGame, GameError
from simulator.catalogue import Catalogue

log = logging.getLogger("simulator")


class Refusal(Exception):
    """An error that ends the session with a status; the text says what came, what was wanted and what to do."""

    def __init__(self, code: grpc.StatusCode, text: str) -> None:
        super().__init__(text)
        self.code = code


def describe(games: Catalogue, name: str, options: Mapping[str, str]) -> pb.GameSpec:
    """Return the spec of a game. Raises Refusal for an unknown game, option or choice."""
    if name not in games:
        known = ", ".join(games)
        raise Refusal(grpc.StatusCode.NOT_FOUND, f"no game named {name!r}; this server has {known}")
    try:
        return games[name].describe(choose_options(games[name].options(), options, name))
    except SpecError as error:
        raise Refusal(grpc.StatusCode.INVALID_ARGUMENT, str(error)) from error


class Session:
    """The arenas of one Play stream."""

    def __init__(self, games: Catalogue) -> None:
        """Begin a session that has not been started yet."""
        self.games = games
        self.game: BatchedGame | None = None
        self.spec = pb.GameSpec()
        self.previous: list[StepArrays] = []  # what the client decides on now
        self.steps = 0

    def answer(self, request: pb.PlayRequest) -> pb.PlayResponse:
        """Return the response to one request. Raises Refusal; the session must then end."""
        kind = request.WhichOneof("request")
        if kind is None:
            raise Refusal(grpc.StatusCode.INVALID_ARGUMENT, "an empty PlayRequest; send start, act, reset or save")
        if (kind == "start") == (self.game is not None):
            wanted = "start comes once, first" if kind == "start" else f"{kind} came before start"
            raise Refusal(grpc.StatusCode.FAILED_PRECONDITION, f"{wanted}; open a new stream and begin with start")
        try:
            return getattr(self, f"_{kind}")(getattr(request, kind))  # type: ignore[no-any-return]
        except (TensorError, SpecError) as error:
            raise Refusal(grpc.StatusCode.INVALID_ARGUMENT, str(error)) from error
        except Refusal:
            raise
        except Exception as error:
            # An author's bug must not take the server with it: report it here, log it there.
            log.exception("game %s failed in step %d", self.spec.name, self.steps)
            place = str(error) if isinstance(error, GameError) else f"{type(error).__name__}: {error}"
            text = f"{self.spec.name} failed in step {self.steps}: {place}; the traceback is in the server's log"
            raise Refusal(grpc.StatusCode.INTERNAL, text) from error

    def _start(self, start: pb.Start) -> pb.PlayResponse:
        spec = describe(self.games, start.game, start.options)
        self.spec = spec
        if not 1 <= start.arenas <= spec.max_arenas:
            code = grpc.StatusCode.INVALID_ARGUMENT if start.arenas == 0 else grpc.StatusCode.RESOURCE_EXHAUSTED
            raise Refusal(code, f"{spec.name}: arenas is {start.arenas}, expected 1..{spec.max_arenas}")
        options = choose_options(spec.options, start.options, spec.name)
        parameters = choose_parameters(spec.parameters, start.parameters, spec.name)
        game = self.games[start.game](options, parameters, start.arenas, start.first_arena, start.seed)
        if start.HasField("snapshot"):
            self._require_snapshots()
            restore(game, start.snapshot)
        self.game = game
        return pb.PlayResponse(started=pb.Started(spec=spec, step=self._observe()))

    def _act(self, act: pb.Act) -> pb.PlayResponse:
        assert self.game is not None
        behaviours = self.spec.behaviours
        if len(act.behaviours) != len(behaviours):
            raise TensorError(f"act.behaviours has {len(act.behaviours)} entries, expected {len(behaviours)}")
        acts = [
            unpack_act(message, behaviour, previous)
            for message, behaviour, previous in zip(act.behaviours, behaviours, self.previous, strict=True)
        ]
        self._check_draw(act)
        begin = time.perf_counter()
        self.previous = self.game.step(acts)
        seconds = time.perf_counter() - begin
        self.steps += 1
        step = pb.Step(behaviours=[pack_step(s) for s in self.previous], simulate_seconds=seconds)
        step.pictures.extend(pack(np.ascontiguousarray(self.game.draw(arena))) for arena in act.draw)
        return pb.PlayResponse(step=step)

    def _reset(self, reset: pb.Reset) -> pb.PlayResponse:
        assert self.game is not None
        parameters = choose_parameters(self.spec.parameters, reset.parameters, self.spec.name)
        self.game.reset(reset.seed if reset.HasField("seed") else None, parameters)
        return pb.PlayResponse(step=self._observe())

    def _save(self, save: pb.Save) -> pb.PlayResponse:
        assert self.game is not None
        self._require_snapshots()
        parts = {name: array.tobytes() for name, array in self.game.save().items()}
        return pb.PlayResponse(snapshot=pb.Snapshot(parts=parts))

    def _observe(self) -> pb.Step:
        assert self.game is not None
        self.previous = self.game.observe()
        return pb.Step(behaviours=[pack_step(s) for s in self.previous])

    def _check_draw(self, act: pb.Act) -> None:
        if not act.draw:
            return
        if not self.spec.HasField("picture"):
            raise Refusal(
                grpc.StatusCode.FAILED_PRECONDITION, f"{self.spec.name} cannot be drawn; leave act.draw empty"
            )
        arenas = len(self.previous[0].rewards) // self.spec.behaviours[0].agents_per_arena
        if len(act.draw) > MAX_PICTURES or max(act.draw) >= arenas:
            raise TensorError(
                f"act.draw asks for {len(act.draw)} pictures up to arena {max(act.draw)}, "
                f"expected at most {MAX_PICTURES} of arenas 0..{arenas - 1}"
            )

    def _require_snapshots(self) -> None:
        if not self.spec.snapshot_bytes_per_arena:
            text = f"{self.spec.name} has no snapshots (snapshot_bytes_per_arena is 0); begin new episodes instead"
            raise Refusal(grpc.StatusCode.FAILED_PRECONDITION, text)


def restore(game: BatchedGame, snapshot: pb.Snapshot) -> None:
    """Put a game into a saved state. Raises TensorError where the snapshot is not of a session like this one."""
    present = game.save()
    if set(snapshot.parts) != set(present):
        raise TensorError(f"snapshot has parts {sorted(snapshot.parts)}, expected {sorted(present)}")
    state = {}
    for name, array in present.items():
        data = snapshot.parts[name]
        if len(data) != array.nbytes:
            raise TensorError(f"snapshot part {name!r} has {len(data)} bytes, expected {array.nbytes} for this session")
        state[name] = np.frombuffer(data, array.dtype).reshape(array.shape)
    try:
        game.restore(state)
    except ValueError as error:
        raise TensorError(f"snapshot: {error}") from error
