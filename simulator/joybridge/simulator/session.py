"""One session: it answers requests, and checks every rule of bridge.proto about their order and content.

It uses no gRPC, so tests need no connection.
"""

import hashlib
import json
import logging
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import numpy as np

from joybridge.contract.codec import ActArrays, Codec, StepArrays, fill, fill_step
from joybridge.contract.distributions import choose_distributions
from joybridge.contract.errors import JoybridgeError, MessageError
from joybridge.contract.limits import max_pictures
from joybridge.contract.spec import check_spec, choose_options, choose_parameters
from joybridge.contract.statuses import status
from joybridge.contract.tensors import Array, TensorError
from joybridge.contract.text import printable
from joybridge.contract.versions import mismatch, own_version
from joybridge.simulator.batched_game import BatchedGame, GameError
from joybridge.simulator.catalog import Catalog
from joybridge.v1 import bridge_pb2 as pb

log = logging.getLogger("simulator")

EMPTY = "an empty PlayRequest, or a request that this server does not know; send start, act, reset or save"
# Characters of a long text that are kept. gRPC gives a status 8 KiB. A character of the sentence takes up to 18 bytes
# of them, because the details repeat it, and one of the field up to 6.
HEAD, TAIL = 250, 130
FIELD_HEAD, FIELD_TAIL = 90, 30
BRIEF_SECONDS = 0.01  # of a step; handing a request to a thread and back costs less than 2 % of this


class Refusal(JoybridgeError):
    """An error that ends the session with a gRPC status. The text names what was received and expected, and the fix.

    field: the path of the wrong field from the request, "" if there is none.
    """

    def __init__(self, reason: "pb.Reason", text: str, field: str = "") -> None:
        super().__init__(_cut(text, HEAD, TAIL))
        self.reason = reason
        self.field = _cut(field, FIELD_HEAD, FIELD_TAIL)

    def status(self) -> Any:
        """Return the grpc.Status; see `joybridge.contract.statuses.status`."""
        return status(self.reason, str(self), self.field)


def _cut(text: str, head: int, tail: int) -> str:
    """Return a printable text without its middle if it is long."""
    for _ in range(2):  # before anything looks at every character, and after some became longer
        if len(text) > head + tail:
            text = f"{text[:head]} … {text[-tail:]}"
        text = printable(text)
    return text


@contextmanager
def checking(where: str) -> Iterator[None]:
    """Raise MessageError as Refusal: the request is wrong, not the game. where: the path of what is checked."""
    try:
        yield
    except MessageError as error:
        raise Refusal(error.reason, str(error), f"{where}.{error.field}".strip(".")) from error


def check_version(client: pb.Version) -> None:
    """Raise Refusal if a client needs a newer revision of the contract than this server has."""
    if text := mismatch(client, own_version()):
        raise Refusal(pb.REASON_OLD_SERVER, text)


def failure(game: str, moment: str, error: BaseException) -> Refusal:
    """Log the exception of a game that is being handled, and return the Refusal for the client.

    What the game itself has raised is logged, without the calls of the server around it.
    """
    ours = isinstance(error, GameError)
    place = str(error) if ours else f"{type(error).__name__}: {error}"
    log.error("%s failed in %s: %s", game, moment, place, exc_info=(ours and error.__cause__) or error)
    text = f"{game} failed in {moment}: {place}; the traceback is in the server's log"
    return Refusal(pb.REASON_GAME_FAILED, text)


def describe(games: Catalog, name: str, options: Mapping[str, str], where: str = "") -> pb.GameSpec:
    """Return the spec of a game. Raises Refusal for an unknown game, option or choice, and for a broken spec.

    where: the path of the message that has them.
    """
    if name not in games:
        known = ", ".join(games)
        text = (
            f"no game named {name!r}; this server has {known}; name one of your own as MODULE:CLASS after --game, "
            "or with --gym or --pygame"
        )
        raise Refusal(pb.REASON_UNKNOWN_GAME, text, f"{where}.game".strip("."))
    with checking(where):
        chosen = choose_options(games[name].options, options, name)
    try:
        spec = games[name].describe(chosen)
        check_spec(spec)
    except BaseException as error:
        raise failure(name, "describe", error) from error
    return spec


class Session:
    """The arenas of one Play stream."""

    def __init__(self, games: Catalog) -> None:
        """Create a session. It has no arenas before Start."""
        self.games = games
        self.game: BatchedGame | None = None
        self.spec = pb.GameSpec()
        self.codecs: list[Codec] = []
        self.origin = b""  # see `hash_of_start`; a snapshot contains it
        self.previous: list[StepArrays] = []  # the last step, which the next Act answers
        self.arenas = 0
        self.steps = 0
        self.brief = False  # whether the next step takes so little time that the event loop may wait for it

    def is_brief(self, request: pb.PlayRequest) -> bool:
        """Return whether the answer takes so little time that the event loop may wait for it."""
        return self.brief and request.HasField("act") and not _draws(request.act)

    def answer(self, request: pb.PlayRequest) -> pb.PlayResponse:
        """Return the response to one request. Raises Refusal; the session must then end."""
        kind = request.WhichOneof("request")
        if kind is None:
            raise Refusal(pb.REASON_UNKNOWN_REQUEST, EMPTY)
        if (kind == "start") == (self.game is not None):
            wanted = "start came a second time" if kind == "start" else f"{kind} came before start"
            raise Refusal(pb.REASON_WRONG_ORDER, f"{wanted}; open a new stream and begin with start")
        try:
            return getattr(self, f"_{kind}")(getattr(request, kind))  # type: ignore[no-any-return]
        except Refusal:
            raise
        except BaseException as error:  # whatever a game raises, exit() included, must not end the server
            raise failure(self.spec.name, f"step {self.steps}", error) from error

    def close(self) -> None:
        """Free what the game holds."""
        if self.game is not None:
            try:
                self.game.close()
            except BaseException:  # the session has ended, so nobody else hears of it
                log.exception("game %s failed to close", self.spec.name)

    def _start(self, start: pb.Start) -> pb.PlayResponse:
        check_version(start.version)
        spec = describe(self.games, start.game, start.options, "start")
        self.spec = spec
        if not 1 <= start.arenas <= spec.max_arenas:
            reason = pb.REASON_NO_ARENAS if start.arenas == 0 else pb.REASON_TOO_MANY_ARENAS
            text = f"{spec.name}: arenas is {start.arenas}, expected 1..{spec.max_arenas}"
            raise Refusal(reason, text, "start.arenas")
        with checking("start"):
            options = choose_options(spec.options, start.options, spec.name)
            parameters = choose_parameters(spec.parameters, start.parameters, spec.name)
            distributions = choose_distributions(spec, start.distributions, parameters)
        self.arenas = start.arenas
        self.game = game = self.games[start.game](options, parameters, start.arenas, start.first_arena, start.seed)
        if distributions:
            game.distributions = distributions
            game.reset(start.seed, {})
        self.origin = hash_of_start(spec, options, parameters, start)
        if start.HasField("snapshot"):
            self._require_snapshots()
            with checking("start.snapshot"):
                restore(game, start.snapshot, self.origin)
        self.codecs = [Codec(behavior, start.arenas, len(spec.parameters)) for behavior in spec.behaviors]
        response = pb.PlayResponse(started=pb.Started(spec=spec, version=own_version()))
        self._observe(response.started.step)
        return response

    def _act(self, act: pb.Act) -> pb.PlayResponse:
        assert self.game is not None
        acts = self._unpack(act)
        self._check_draw(act)
        if act.distributions:
            with checking("act"):
                self.game.distributions = {
                    **self.game.distributions,
                    **choose_distributions(self.spec, act.distributions),
                }
        self.steps += 1
        self.game.drawn_by_tick = act.draw_ticks if act.HasField("draw_ticks") else None
        begin = time.perf_counter()
        self.previous = self.game.step(acts)
        seconds = time.perf_counter() - begin
        self.brief = self.game.in_event_loop and seconds < BRIEF_SECONDS
        response = pb.PlayResponse(step=pb.Step(simulate_seconds=seconds))
        self._fill(response.step)
        for arena in act.draw:
            fill(response.step.pictures.add(), self._picture(self.game.draw(arena), arena))
        if act.HasField("draw_ticks"):
            for picture in self.game.tick_pictures:
                fill(response.step.tick_pictures.add(), self._picture(picture, act.draw_ticks))
        return response

    def _reset(self, reset: pb.Reset) -> pb.PlayResponse:
        assert self.game is not None
        with checking("reset"):
            parameters = choose_parameters(self.spec.parameters, reset.parameters, self.spec.name)
            distributions = choose_distributions(self.spec, reset.distributions, parameters)
        stay = {name: one for name, one in self.game.distributions.items() if name not in parameters}
        self.game.distributions = stay | distributions
        self.game.reset(reset.seed if reset.HasField("seed") else None, parameters)
        response = pb.PlayResponse()
        self._observe(response.step)
        return response

    def _save(self, save: pb.Save) -> pb.PlayResponse:
        assert self.game is not None
        self._require_snapshots()
        parts = {name: array.tobytes() for name, array in self.game.save().items()}
        return pb.PlayResponse(snapshot=pb.Snapshot(parts=parts | {"origin": self.origin}))

    def _observe(self, message: pb.Step) -> None:
        assert self.game is not None
        self.previous = self.game.observe()
        self._fill(message)

    def _fill(self, message: pb.Step) -> None:
        for step in self.previous:
            fill_step(message.behaviors.add(), step)

    def _unpack(self, act: pb.Act) -> list[ActArrays]:
        messages, codecs = act.behaviors, self.codecs
        if len(messages) != len(codecs):
            text = f"act.behaviors has {len(messages)} entries, expected {len(codecs)}"
            raise Refusal(pb.REASON_WRONG_BEHAVIORS, text, "act.behaviors")
        acts = []
        for index, codec in enumerate(codecs):
            with checking(f"act.behaviors[{index}]"):
                acts.append(codec.unpack_act(messages[index], self.previous[index]))
        return acts

    def _check_draw(self, act: pb.Act) -> None:
        if not _draws(act):
            return
        field = "act.draw" if act.draw else "act.draw_ticks"
        if not self.spec.HasField("picture"):
            raise Refusal(pb.REASON_NO_PICTURES, f"{self.spec.name} cannot be drawn; leave {field} empty", field)
        last, count, most = max([*act.draw, act.draw_ticks]), len(act.draw), max_pictures(self.spec)
        if act.HasField("draw_ticks"):
            count += self.spec.decision_interval - 1
        if count > most or last >= self.arenas:
            text = (
                f"{field} asks for {count} pictures up to arena {last}, "
                f"expected at most {most} of arenas 0..{self.arenas - 1}"
            )
            raise Refusal(pb.REASON_WRONG_DRAW, text, field)

    def _picture(self, picture: Array, arena: int) -> Array:
        """Return what the game has drawn of an arena. Raises GameError if the spec says something else."""
        size = (self.spec.picture.height, self.spec.picture.width, 3)
        if picture.dtype != np.uint8 or picture.shape != size:
            came = f"{picture.dtype} {list(picture.shape)}"
            raise GameError(f"arena {arena}: draw returned {came}, expected uint8 {list(size)}")
        return picture

    def _require_snapshots(self) -> None:
        if not self.spec.snapshot_bytes_per_arena:
            text = f"{self.spec.name} has no snapshots (snapshot_bytes_per_arena is 0); begin new episodes instead"
            raise Refusal(pb.REASON_NO_SNAPSHOTS, text)


def _draws(act: pb.Act) -> bool:
    return bool(act.draw) or act.HasField("draw_ticks")


def hash_of_start(
    spec: pb.GameSpec, options: Mapping[str, str], parameters: Mapping[str, float], start: pb.Start
) -> bytes:
    """Return a hash of what a session and the one that continues from its snapshot must share.

    Options and parameters count only where they differ from the default, so snapshots stay valid when a game gets a new
    one.
    """
    usual = {option.name: option.default_choice for option in spec.options}
    values = {parameter.name: parameter.default_value for parameter in spec.parameters}
    chosen = sorted(options.items() - usual.items()), sorted(parameters.items() - values.items())
    how = [spec.name, *chosen, start.arenas, start.first_arena, start.seed]
    return hashlib.blake2b(json.dumps(how).encode(), digest_size=16).digest()


def restore(game: BatchedGame, snapshot: pb.Snapshot, origin: bytes) -> None:
    """Restore a game from a snapshot. Raises TensorError if the snapshot does not fit this session."""
    present = game.save()
    wanted = {"origin", *present}
    if set(snapshot.parts) != wanted:
        raise wrong_snapshot(f"has parts {sorted(snapshot.parts)}, expected {sorted(wanted)}", "parts")
    state = {}
    for name, array in present.items():
        data = snapshot.parts[name]
        if len(data) != array.nbytes:
            text = f"part {name!r} has {len(data)} bytes, expected {array.nbytes} for this session"
            raise wrong_snapshot(text, f"parts[{name}]")
        state[name] = np.frombuffer(data, array.dtype).reshape(array.shape)
    if snapshot.parts["origin"] != origin:
        raise wrong_snapshot(
            "is from a session with another Start; use the same game, options, parameters, arenas, seed and first_arena"
        )
    try:
        game.restore(state)
    except ValueError as error:
        raise TensorError(f"snapshot: {error}", pb.REASON_WRONG_SNAPSHOT) from error


def wrong_snapshot(text: str, field: str = "") -> TensorError:
    """Return the error for a snapshot that does not fit a session. field: its path in the snapshot."""
    return TensorError(f"snapshot {text}", pb.REASON_WRONG_SNAPSHOT, field)
