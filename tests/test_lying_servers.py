"""What no server may send: a session or a call ends with a sentence, or goes on without it."""

import numpy as np
import pytest

from joybridge.client.client import Session, SimulatorError, list_games
from joybridge.layouts import make_acts
from joybridge.v1 import bridge_pb2 as pb
from tests.support.broken_servers import BrokenServer, Honest, serving
from tests.support.servers import answering_methods


class PaysAtTheStart(Honest):
    def first(self, step):
        rewards = step.behaviors[0].rewards
        rewards.data = np.ones(rewards.shape, np.float32).tobytes()


class TakesForEver(Honest):
    def later(self, step):
        step.simulate_seconds = float("-inf")


class NamesNoSocket(Honest):
    def answer(self, request):
        response = super().answer(request)
        if response.HasField("started"):
            response.started.local_socket = "a\0b"
        return response


@pytest.mark.parametrize(
    ("kind", "problem"),
    [(PaysAtTheStart, "rewards are paid, before the first decision"), (TakesForEver, "simulate_seconds is -inf")],
)
def test_steps_that_cannot_be_true_are_refused(kind, problem):
    with (
        serving(BrokenServer(set(), session=kind)) as address,
        pytest.raises(SimulatorError, match=problem),
        Session(address, "gauntlet", arenas=3, seed=0) as session,
    ):
        session.step(make_acts(session.spec, 3))


def test_a_path_that_names_no_socket_leaves_the_session_on_its_stream():
    with serving(BrokenServer(set(), session=NamesNoSocket)) as address:
        with Session(address, "gauntlet", arenas=3, seed=0) as session:
            session.step(make_acts(session.spec, 3))
        with pytest.raises(SimulatorError, match="no local transport"):
            Session(address, "gauntlet", arenas=3, seed=0, transport="local")


@pytest.mark.parametrize("names", [[], [""], ["a\x1b]0;owned\x07"], ["b\nerror: no"], ["a", "b" * 101]])
def test_games_whose_names_are_no_names_are_refused(names):
    response = pb.ListGamesResponse(games=[pb.GameSummary(name=name) for name in names])
    with (
        answering_methods(ListGames=lambda *_: response.SerializeToString()) as address,
        pytest.raises(SimulatorError, match=f"sent {len(names)} games, expected at least one, with printable"),
    ):
        list_games(address)
