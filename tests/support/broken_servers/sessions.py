"""Servers whose sessions disturb each other, or are too many."""

import grpc

from joybridge.simulator.session import Refusal
from joybridge.v1 import bridge_pb2 as pb
from tests.support.broken_servers.gauntlet import Gauntlet
from tests.support.broken_servers.serving import Honest, Service, broken


@broken(
    "parallel_sessions_are_independent",
    "reset_does_not_affect_other_sessions",
    "cancelled_session_does_not_affect_others",
    "lost_connection_does_not_affect_other_sessions",
)
class SessionsShareTheirSeed(Gauntlet):
    newest = 0

    def reset(self, seed, parameters):
        SessionsShareTheirSeed.newest = self.newest if seed is None else seed
        super().reset(seed, parameters)

    def draws(self, arena):
        self.seed = self.newest
        return super().draws(arena)


class Leaks(Service):
    """Counts every session for ever."""

    most = 12

    def __init__(self, broken):
        super().__init__(broken)
        self.open = 0

    def Play(self, requests, context):
        if self.open == self.most:
            context.abort(grpc.StatusCode.RESOURCE_EXHAUSTED, f"{self.most} sessions are open")
        self.open += 1
        yield from super().Play(requests, context)


class AnswersTwice(Service):
    """Sends the response to every Act twice."""

    def Play(self, requests, context):
        for response in super().Play(requests, context):
            yield response
            if response.HasField("step"):
                yield response


@broken("zero_arenas_are_refused")
class NoArenasIsOne(Honest):
    def request(self, request):
        if request.HasField("start"):
            request.start.arenas = request.start.arenas or 1
        return request


@broken("more_than_max_arenas_are_refused", "largest_number_of_arenas_is_refused")
class TooManyArenasAreInvalid(Honest):
    def answer(self, request):
        if request.start.arenas > 16:
            raise Refusal(pb.REASON_NO_ARENAS, "too many arenas")
        return super().answer(request)
