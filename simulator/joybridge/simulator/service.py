"""The calls of joybridge.v1.SimulatorService: who may play, for how long, and where the game runs.

One event loop serves all sessions, and each session has a thread for its game (see game_thread.py). Over gRPC, only the
steps of games that declare `in_event_loop` run in the loop itself: handing a step to a thread and back costs more than
such a step (measured: 330 against 160 µs per round trip of 64 lanes). If the messages go over a Unix socket, the thread
reads and writes them itself.
"""

import asyncio
import math
import time
from collections.abc import Awaitable, Callable
from typing import Any, NamedTuple, TypeAlias, TypeVar, TypeVarTuple, cast

import grpc
from google.protobuf.message import DecodeError

from joybridge.contract.limits import request_bytes
from joybridge.contract.memory import free_memory
from joybridge.contract.versions import own_version
from joybridge.simulator.catalog import Catalog
from joybridge.simulator.game_thread import GameThread
from joybridge.simulator.local_socket import LocalListener
from joybridge.simulator.session import Refusal, Session, check_version, describe
from joybridge.v1 import bridge_pb2 as pb
from joybridge.v1 import bridge_pb2_grpc as rpc

READING, ANSWERING, WRITING = "reading", "answering", "writing"  # what a stream is doing
SWEEP_SECONDS = 1.0  # between two looks at the streams that wait for their clients
Context: TypeAlias = Any  # grpc.aio.ServicerContext; gRPC has no types
Arguments = TypeVarTuple("Arguments")
T = TypeVar("T")


class Limits(NamedTuple):
    """How many sessions a server has, and how long it waits. Seconds may be infinite."""

    sessions: int = 64
    step_seconds: float = 30.0  # for a game to describe itself or to answer a request
    start_seconds: float = 10.0  # for a client to send Start, and to connect to the socket that it has asked for
    idle_seconds: float = 3600.0  # for a client to send its next request, or to receive a response


class ServerStream:
    """A Play stream: its session, the thread of its game, and what it is doing since when."""

    def __init__(self, games: Catalog, step_seconds: float) -> None:
        self.session = Session(games)
        self.game = ""  # its name
        self.thread = GameThread(step_seconds)
        self.task = cast("asyncio.Task[Any]", asyncio.current_task())
        self.local: LocalListener | None = None  # what replaces it for messages, if the client asked for that
        self.playing = False  # whether it has one of the places of the server
        self.now(READING)
        self.ending: Refusal | None = None  # why the server ends it

    def now(self, doing: str) -> None:
        """Note what the stream is doing from now on."""
        self.since = time.monotonic()  # first, as another thread may look
        self.doing = doing

    def silent_seconds(self) -> float:
        """Return how long the stream has been waiting for its client."""
        return 0.0 if self.doing == ANSWERING else time.monotonic() - self.since

    def busy_seconds(self) -> float:
        """Return how long the game has been at work for the present request."""
        return time.monotonic() - self.since if self.doing == ANSWERING else 0.0

    def offer_socket(self, peer: str, seconds: float) -> LocalListener | None:
        """Return a Unix socket for the rest of the session, None if a client with this gRPC address cannot have one.

        seconds: how long the socket waits for the client to connect.
        """
        self.local = LocalListener.offer(peer, request_bytes(self.session.spec, self.session.arenas), seconds)
        return self.local

    def play_locally(self, local: LocalListener) -> None:
        """Answer what comes over the socket, until the client closes it. This blocks, in the thread of the game.

        Raises Refusal and DecodeError.
        """
        if not local.accept():
            return
        while (request := local.read()) is not None:
            self.now(ANSWERING)
            response = self.session.answer(request)
            self.now(WRITING)
            if not local.write(response):
                return
            self.now(READING)
            if self.ending is not None:
                raise self.ending

    def close(self) -> None:
        """Free what the game and the socket hold."""
        self.session.close()
        if self.local is not None:
            self.local.close()

    def release(self) -> None:
        """Let the thread of the game end, after it has freed what the game and the socket hold. May be called again."""
        if self.local is not None:
            self.local.end()
        self.thread.end(self.close)

    def end(self, reason: Refusal) -> None:
        """End the stream with a status. A response that is being sent is sent completely before the status."""
        self.ending = reason
        if self.doing != WRITING:
            self.task.cancel()


class Service(rpc.SimulatorServiceServicer):
    """Answers the calls of joybridge.v1.SimulatorService."""

    def __init__(self, games: Catalog, limits: Limits) -> None:
        """Serve these games."""
        self.games = games
        self.limits = limits
        self.streams: set[ServerStream] = set()
        self.ended = False  # whether a stream has ended since the last sweep
        self.describers: dict[str, GameThread] = {}  # for DescribeGame, by game

    async def ListGames(self, request: pb.ListGamesRequest, context: Context) -> pb.ListGamesResponse:
        """List the games of this server."""
        try:
            check_version(request.version)
        except Refusal as refusal:
            await context.abort(*refusal.status())
        games = [pb.GameSummary(name=game.name, description=game.description) for game in self.games.values()]
        return pb.ListGamesResponse(games=games, version=own_version())

    async def DescribeGame(self, request: pb.DescribeGameRequest, context: Context) -> pb.DescribeGameResponse:
        """Describe one game under the given options."""
        try:
            check_version(request.version)
            spec = await self._describe(request)
        except Refusal as refusal:
            await context.abort(*refusal.status())
        return pb.DescribeGameResponse(spec=spec, version=own_version())

    async def _describe(self, request: pb.DescribeGameRequest) -> pb.GameSpec:
        game = self.games.get(request.game)
        if game is None or game.in_event_loop:
            return describe(self.games, request.game, request.options)
        thread = self.describers.get(request.game)
        if thread is None or not thread.is_alive():
            thread = self.describers[request.game] = GameThread(self.limits.step_seconds)
        try:
            return await thread.answer(describe, self.games, request.game, request.options)
        except TimeoutError:
            raise self._too_slow(request.game, "describe") from None

    async def Play(self, requests: object, context: Context) -> None:
        """Run one session until either side ends it."""
        stream = ServerStream(self.games, self.limits.step_seconds)
        self.streams.add(stream)
        try:
            while (request := await cast(Awaitable[Any], context.read())) is not grpc.aio.EOF:
                if stream.session.is_brief(request):
                    response = stream.session.answer(request)
                else:
                    stream.now(ANSWERING)
                    response = await self._begin_or_answer(stream, request)
                    if request.start.local_transport:
                        local = stream.offer_socket(context.peer(), self.limits.start_seconds)
                        response.started.local_socket = local.path if local else ""
                stream.now(WRITING)
                await context.write(response)
                stream.now(READING)
                if stream.ending is not None:
                    raise stream.ending
                if stream.local is not None:
                    await self._in_thread(stream, stream.play_locally, stream.local, busy=stream.busy_seconds)
                    return
        except Refusal as refusal:
            await context.abort(*refusal.status())
        except DecodeError as error:
            malformed = Refusal(pb.REASON_MALFORMED_MESSAGE, f"not a PlayRequest: {error}")
            await context.abort(*malformed.status())
        except grpc.aio.InternalError:  # the client has gone while a response was on its way
            raise asyncio.CancelledError from None
        except asyncio.CancelledError:
            # Without a reason the client has gone. And while a response is being sent over gRPC, no status can be.
            if stream.ending is None or (stream.doing == WRITING and stream.local is None):
                raise
            await context.abort(*stream.ending.status())
        finally:
            self.streams.discard(stream)
            stream.release()
            self.ended = True

    async def _begin_or_answer(self, stream: ServerStream, request: pb.PlayRequest) -> pb.PlayResponse:
        """Answer in the thread of the game. The first request takes a place of the server."""
        if not stream.playing:
            self._take_place(stream)
        stream.game = stream.game or request.start.game
        game = self.games.get(stream.game)
        if game is not None and game.in_event_loop:
            stream.thread.seconds = math.inf  # its steps always end, but the first ones compile its rules
        return await self._in_thread(stream, stream.session.answer, request)

    async def _in_thread(
        self,
        stream: ServerStream,
        function: Callable[[*Arguments], T],
        *args: *Arguments,
        busy: Callable[[], float] | None = None,
    ) -> T:
        """Call a function in the thread of the game; see GameThread.answer. Raises Refusal if the game is too slow."""
        try:
            return await stream.thread.answer(function, *args, busy=busy)
        except TimeoutError:
            session = stream.session
            raise self._too_slow(stream.game, f"step {session.steps}", session.arenas) from None

    def _take_place(self, stream: ServerStream) -> None:
        """Give the stream one of the places of the server. Raises Refusal if all are taken."""
        silent = [other.silent_seconds() for other in self.streams if other.playing]
        if len(silent) >= self.limits.sessions:
            idle = f"{len(silent)} sessions are open already, one of them idle for {max(silent):.0f} s"
            text = f"{idle}; close one or start the server with --sessions"
            raise Refusal(pb.REASON_TOO_MANY_SESSIONS, text)
        stream.playing = True

    def _too_slow(self, game: str, moment: str, arenas: int = 0) -> Refusal:
        where = f" of {arenas} arenas" if arenas else ""
        text = (
            f"{game} failed in {moment}{where}: no result after {self.limits.step_seconds:g} s; its stack is in the "
            "server's log; a game that needs more time is served with --step-seconds"
        )
        return Refusal(pb.REASON_GAME_TOO_SLOW, text)

    async def sweep(self) -> None:
        """End streams whose clients are silent for too long, and free memory, until this is cancelled."""
        while True:
            await asyncio.sleep(SWEEP_SECONDS)
            if self.ended:
                self.ended = False
                await asyncio.to_thread(free_memory)
            self.end_silent_streams()

    def end_silent_streams(self) -> None:
        """End the streams whose clients are silent for too long."""
        for stream in list(self.streams):
            limit = self.limits.idle_seconds if stream.playing else self.limits.start_seconds
            if stream.silent_seconds() <= limit:
                continue
            if stream.ending is None:
                wanted = "request (see --idle-seconds)" if stream.playing else "start (see --start-seconds)"
                reason = pb.REASON_IDLE if stream.playing else pb.REASON_NO_START
                stream.end(Refusal(reason, f"no {wanted} for {limit:g} s; open a new stream"))
            elif stream.doing == WRITING:  # since the last sweep: the client does not read, so no status can reach it
                stream.task.cancel()

    def end_streams(self) -> int:
        """End every stream with UNAVAILABLE, and return how many of them were sessions."""
        for stream in list(self.streams):
            stream.end(Refusal(pb.REASON_SHUTTING_DOWN, "the simulator is shutting down"))
        for thread in self.describers.values():
            thread.end()
        return sum(stream.playing for stream in self.streams)

    def release_streams(self) -> None:
        """Release the streams that gRPC has ended, but whose `Play` has not come to its end yet."""
        for stream in self.streams:
            stream.release()
