"""A server in threads of this process, its places for what is to be broken, and how a broken one is kept."""

from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import grpc
import numpy as np
from grpc_health.v1 import health, health_pb2, health_pb2_grpc
from grpc_reflection.v1alpha import reflection

from joybridge.conformance.client import OPEN
from joybridge.contract.codec import pack
from joybridge.contract.credentials import AUTHORIZATION, NO_COMPRESSION, Credentials
from joybridge.contract.tensors import NUMPY_TYPES
from joybridge.contract.versions import own_version
from joybridge.simulator import BatchedGame
from joybridge.simulator import session as sessions
from joybridge.simulator.session import Refusal, Session
from joybridge.v1 import bridge_pb2 as pb
from joybridge.v1 import bridge_pb2_grpc as rpc
from tests.support.broken_servers.gauntlet import Gauntlet

SERVICE = "joybridge.v1.SimulatorService"


class Service(rpc.SimulatorServiceServicer):  # type: ignore[misc]
    """Answers the calls with a session, which knows all the rules."""

    def __init__(self, broken):
        self.games = {Gauntlet.name: broken.game}
        self.session = broken.session

    def ListGames(self, request, context):
        try:
            self.session.look(request)
            games = [pb.GameSummary(name=Gauntlet.name, description=Gauntlet.description)]
            return pb.ListGamesResponse(games=games, version=self.session.version())
        except Refusal as refusal:
            return context.abort_with_status(refusal.status())

    def DescribeGame(self, request, context):
        try:
            self.session.look(request)
            spec = self.session.describe(self.games, request.game, request.options)
            return pb.DescribeGameResponse(spec=spec, version=self.session.version())
        except Refusal as refusal:
            return context.abort_with_status(refusal.status())

    def Play(self, requests, context):
        session = self.session(self.games)
        try:
            for request in requests:
                yield session.answer(request)
        except Refusal as refusal:
            context.abort_with_status(refusal.status())


class Honest(Session):
    """A session like any other, with places for what is to be broken."""

    @staticmethod
    def look(request):
        sessions.check_version(request.version)

    @staticmethod
    def version():
        return own_version()

    @staticmethod
    def describe(games, name, options):
        return sessions.describe(games, name, options)

    def answer(self, request):
        response = super().answer(self.request(request))
        kind = response.WhichOneof("response")
        if kind == "snapshot":
            self.saved(response.snapshot)
        else:
            first = kind == "started"
            step = response.started.step if first else response.step
            self.every(step)
            (self.first if first else self.reset if request.HasField("reset") else self.later)(step)
        return response

    def request(self, request):
        return request

    def saved(self, snapshot):
        """Change a snapshot."""

    def every(self, step):
        """Change any step."""

    def first(self, step):
        """Change the step in Started."""

    def reset(self, step):
        """Change the step after a Reset."""

    def later(self, step):
        """Change the step after an Act."""


@dataclass
class BrokenServer:
    """A server with a fault, and the checks that find it: those that fail and those that warn."""

    checks: set[str]
    warned: set[str] = field(default_factory=set)
    game: type[BatchedGame] = Gauntlet
    session: type[Honest] = Honest
    health: tuple[str, ...] = ("", SERVICE)
    reflection: tuple[str, ...] = (SERVICE, reflection.SERVICE_NAME)
    service: type[Service] = Service
    options: list[Any] = field(default_factory=list)
    admits: Callable[[str, str], bool] = lambda method, authorization: True
    credentials: Credentials = OPEN  # of the clients that it should admit


class TokenInterceptor(grpc.ServerInterceptor):  # type: ignore[misc]
    """Refuses the calls that `admits(method, authorization)` does not admit."""

    def __init__(self, admits):
        self.admits = admits

    def intercept_service(self, continuation, call):
        authorization = dict(call.invocation_metadata).get(AUTHORIZATION, "")
        return continuation(call) if self.admits(call.method, authorization) else REFUSAL


def _refuse(requests, context):
    context.abort(grpc.StatusCode.UNAUTHENTICATED, "give the token")


REFUSAL = grpc.stream_stream_rpc_method_handler(_refuse)


class Threads(ThreadPoolExecutor):
    """Threads of a server that is not waited for: a call that comes while it stops finds them gone, and is dropped."""

    def submit(self, *call, **keywords) -> Future[Any]:
        try:
            return super().submit(*call, **keywords)
        except RuntimeError:
            dropped: Future[Any] = Future()
            dropped.cancel()
            return dropped


@contextmanager
def serving(broken, port: int = 0) -> Iterator[str]:
    """Serve in threads of this process and yield the address. port: 0 is a free one."""
    with Threads(32) as threads:
        options = [*broken.options, ("grpc.so_reuseport", 0), NO_COMPRESSION]  # the first of a name counts
        server = grpc.server(threads, options=options, interceptors=[TokenInterceptor(broken.admits)])
        rpc.add_SimulatorServiceServicer_to_server(broken.service(broken), server)
        if broken.health:
            servicer = health.HealthServicer()
            health_pb2_grpc.add_HealthServicer_to_server(servicer, server)
            for name in broken.health:
                servicer.set(name, health_pb2.HealthCheckResponse.SERVING)
        if broken.reflection:
            reflection.enable_server_reflection(broken.reflection, server)
        port = server.add_insecure_port(f"127.0.0.1:{port}")
        server.start()
        try:
            yield f"127.0.0.1:{port}"
        finally:
            server.stop(0)  # and no waiting for it: calls that were broken off may keep it for ever


BROKEN: dict[str, BrokenServer] = {}


def broken(*checks, **fields):
    """Keep a class as a broken server: a session, a game or a service, by its name."""

    def keep(kind):
        part = "game" if issubclass(kind, Gauntlet) else "session" if issubclass(kind, Honest) else "service"
        BROKEN[kind.__name__] = BrokenServer(set(checks), **{part: kind}, **fields)
        return kind

    return keep


def change(tensor, array):
    """Put an array in the place of a tensor."""
    tensor.CopyFrom(pack(np.ascontiguousarray(array)))


def read(tensor):
    return np.frombuffer(tensor.data, NUMPY_TYPES[tensor.dtype]).reshape(tensor.shape).copy()


def floats(tensor):
    return np.frombuffer(tensor.data, "<f4").reshape(tensor.shape).copy()
