"""Scripts of the game's author: what a lane does that one of them plays, and what is refused."""

import numpy as np
import pytest

from joybridge.client.client import Session
from joybridge.contract.codec import ActArrays, Codec, pack_act
from joybridge.contract.tensors import TensorError
from joybridge.games.noughts.game import Noughts, outcome
from joybridge.simulator.batched_game import ArenaError
from joybridge.simulator.game_adapter import batched
from joybridge.simulator.workers.game import in_workers
from joybridge.v1 import bridge_pb2 as pb

PERFECT, CARELESS, RANDOM = 1, 2, 3


def act(lanes: int, *scripts: int) -> ActArrays:
    """Return first choices of all lanes, whatever masks say, and the scripts of the lanes, again and again."""
    return ActArrays(
        np.empty((lanes, 0), np.float32), np.zeros((lanes, 1), np.int32), np.resize(np.array(scripts, np.int32), lanes)
    )


def places(game, decisions: int, *scripts: int):
    """Return the rewards of all ended episodes of one agent, and of the other."""
    ends = []
    for _ in range(decisions):
        (step,) = game.step([act(2 * game.arenas, *scripts)])
        ends += step.rewards[step.ended, 0].reshape(-1, 2).tolist()
    return np.array(ends)


def test_a_perfect_player_never_loses_and_two_of_them_draw():
    game = batched(Noughts)({}, {}, 20, 0, 3)
    against_random = places(game, 60, PERFECT, RANDOM)
    assert len(against_random) > 100 and against_random[:, 0].min() == 0 and against_random[:, 0].mean() > 0.8
    game.reset(4, {})
    assert not places(game, 60, PERFECT, PERFECT).any()


def test_a_careless_player_is_between_the_two():
    game = batched(Noughts)({}, {}, 20, 0, 3)
    against_random, against_perfect = (places(game, 100, CARELESS, other)[:, 0] for other in (RANDOM, PERFECT))
    assert against_random.mean() > 0.2 and -1 <= against_perfect.mean() < -0.2 < 0 <= against_perfect.max()


def test_a_perfect_player_plays_every_move_that_gives_nothing_away():
    arena, chosen = Noughts(), set()
    arena.rng = np.random.default_rng(1)
    arena.marks = [0b1, 0]
    for _ in range(50):
        chosen.add(arena.script("perfect", 1)["field"])
    assert chosen == {4} and outcome(0b1, 0b10000) == 0
    arena.marks = [0, 0]
    assert {arena.script("random", 0)["field"] for _ in range(200)} == set(range(9))


def test_scripts_play_the_same_in_one_process_and_in_workers():
    one = batched(Noughts)({}, {}, 3, 0, 5)
    several = in_workers(batched(Noughts), "joybridge.games.noughts.game:Noughts", 2, 60.0)({}, {}, 3, 0, 5)
    try:
        for _ in range(20):
            (a,), (b,) = (game.step([act(6, RANDOM)]) for game in (one, several))
            assert a.rewards.tobytes() == b.rewards.tobytes()
            assert [o.tobytes() for o in a.observations] == [o.tobytes() for o in b.observations]
    finally:
        several.close()


@pytest.mark.parametrize(
    ("action", "text"),
    [
        ({"field": 0}, "arena 0: player: script 'perfect' chose 0 of 'field', expected one of 9 that is not masked"),
        ({"field": 9}, "script 'perfect' chose 9 of 'field'"),
        ({"row": 1}, r"script 'perfect' returned {'row': 1}, expected a value for each of \['field'\]"),
    ],
)
def test_a_script_that_does_what_no_agent_may_is_an_error_with_the_arena(action, text, monkeypatch):
    game = batched(Noughts)({}, {}, 1, 0, 5)
    first = ActArrays(np.empty((2, 0), np.float32), np.zeros((2, 1), np.int32))
    game.step([first])
    monkeypatch.setattr(Noughts, "script", lambda *_: action)
    with pytest.raises(ArenaError, match=text):
        game.step([act(2, PERFECT)])


def test_a_game_that_lists_scripts_and_has_no_method_says_so(monkeypatch):
    from joybridge.simulator import Game

    monkeypatch.setattr(Noughts, "script", Game.script)
    with pytest.raises(ArenaError, match="noughts has scripts in its spec but no script method"):
        batched(Noughts)({}, {}, 1, 0, 5).step([act(2, PERFECT)])


def test_a_lane_changes_between_client_and_script_over_a_connection(simulator):
    with Session(simulator, "noughts", arenas=8, seed=1, options={}) as session:
        for number in range(30):
            (step,) = session.steps
            assert step.masks is not None and step.deciding is not None
            own = act(16, PERFECT, 0) if number % 2 else act(16, 0, PERFECT)
            own.choices[:, 0] = step.masks[0].argmax(axis=1)  # the first free field
            session.step([own])


@pytest.mark.parametrize(
    ("scripts", "text"),
    [([4, 0], r"got 4 in lane 0, expected 0\.\.3 for perfect, careless, random"), ([0, -1], "got -1 in lane 1")],
)
def test_a_script_that_is_not_there_is_refused_by_its_lane(scripts, text):
    (behavior,) = Noughts.describe({}).behaviors
    message = pack_act(act(2, *scripts))
    (step,) = batched(Noughts)({}, {}, 1, 0, 5).observe()
    with pytest.raises(TensorError, match=text) as caught:
        Codec(behavior, 1).unpack_act(message, step)
    assert caught.value.field == "scripts" and caught.value.reason == pb.REASON_ACTION_OUT_OF_RANGE
    del behavior.scripts[:]
    with pytest.raises(TensorError, match=r"expected 0\.\.0: it has no scripts"):
        Codec(behavior, 1).unpack_act(message, step)
