"""What all games of the hybrid suite share: determinism, ends, options, pictures.

That the games keep the contract over a real server, snapshots included, is the conformance kit's business, in
test_check.py.
"""

import hashlib

import numpy as np
import pytest

from joybridge.contract.codec import ActArrays
from joybridge.games.hybrid_suite.catch_point import CatchPoint
from joybridge.games.hybrid_suite.goal import Goal, HardGoal
from joybridge.games.hybrid_suite.hard_move import HardMove
from joybridge.games.hybrid_suite.moving import Moving, Sliding
from joybridge.games.hybrid_suite.platform import Platform
from tests.support.hybrid_games import close, kick_off, new_game, put

GAMES = [Platform, Goal, HardGoal, CatchPoint, HardMove, Moving, Sliding]


def random_acts(game, options, arenas, random):
    device = game.describe(options).behaviors[0].device
    axes = [random.uniform(axis.low, axis.high, arenas) for axis in device.axes]
    choices = [random.integers(len(branch.choices), size=arenas) for branch in device.branches]
    return [ActArrays(np.stack(axes, 1).astype(np.float32), np.stack(choices, 1).astype(np.int32))]


GOLDEN = {
    "platform": "c9d3ec58035f78a9",
    "goal": "9e4f93860d699289",
    "hard_goal": "e76511ffc1194c77",
    "catch_point": "06eb16c5597d1711",
    "hard_move": "e54323a095313209",
    "moving": "fd247f1c1dea0423",
    "sliding": "bee6b8e1fcfb09b1",
}


def play(game, decisions=60, arenas=4):
    """Return the bytes of everything that random play shows."""
    chosen = {option.name: option.default_choice for option in game.options}
    played, random = new_game(game, arenas), np.random.default_rng(1)
    parts = []
    for _ in range(decisions):
        (step,) = played.step(random_acts(game, chosen, arenas, random))
        parts += [*step.observations, step.rewards, step.terminated, step.truncated]
    return b"".join(part.tobytes() for part in parts)


@pytest.mark.parametrize("game", GAMES, ids=lambda game: game.name)
def test_a_seeded_run_gives_the_same_bytes_on_every_machine(game):
    assert hashlib.sha256(play(game)).hexdigest()[:16] == GOLDEN[game.name]


def digest_of_a_short_run():
    return hashlib.sha256(b"".join(play(game, decisions=3) for game in GAMES)).hexdigest()


ENDED = {  # the state before the last decision, what it is, and the distance to the aim after it
    Platform: ({"x": 1000.0, "vx": 60.0, "noise": 0.0}, 0, 30.0, 0.0),
    CatchPoint: ({"x": 0.1, "y": 0.0, "target_x": 0.2, "target_y": 0.0}, 1, 0.0, 0.1),
    HardMove: ({"x": 0.1, "y": 0.0, "target_x": 0.1, "target_y": 0.1}, 0, 0.0, 0.1),
    Sliding: ({"x": 0.1, "y": 0.0, "target_x": 0.1, "target_y": 0.05}, 2, 0.0, 0.05),
}


@pytest.mark.parametrize("game", ENDED, ids=lambda game: game.name)
def test_an_end_is_reported_with_its_metrics_and_another_episode_begins(game):
    state, choice, strength, distance = ENDED[game]
    played = new_game(game)
    put(played, **state)
    device = game.describe({option.name: option.default_choice for option in game.options}).behaviors[0].device
    choices = np.full((1, len(device.branches)), choice, np.int32)
    (step,) = played.step([ActArrays(np.full((1, len(device.axes)), strength, np.float32), choices)])
    assert step.terminated.tolist() == [True] and step.ended.tolist() == [0]
    close(step.metrics, [[1.0, distance]])
    assert not played.fields["decisions"].any() and not played.fields["success"].any()
    last, first = (np.concatenate(each, axis=1) for each in (step.final_observations, step.observations))
    assert not np.array_equal(last, first)


@pytest.mark.parametrize("game", GAMES, ids=lambda game: game.name)
def test_an_arena_plays_alike_alone_and_among_others(game):
    options = {option.name: option.default_choice for option in game.options}
    many, alone, random = new_game(game, 8), new_game(game, first_arena=5), np.random.default_rng(2)
    for _ in range(120):
        (act,) = random_acts(game, options, 8, random)
        (step,) = many.step([act])
        (own,) = alone.step([ActArrays(act.axes[5:6], act.choices[5:6])])
        assert np.array_equal(step.rewards[5], own.rewards[0])
        for values, lone in zip(step.observations, own.observations, strict=True):
            assert np.array_equal(values[5], lone[0])


@pytest.mark.parametrize("game", [game for game in GAMES if game is not HardMove], ids=lambda game: game.name)
def test_parameters_of_other_choices_change_nothing(game):
    """What a policy does with an axis that does not count must be without effect."""
    options = {option.name: option.default_choice for option in game.options}
    device = game.describe(options).behaviors[0].device
    (branch,) = device.branches
    counting = [
        [index for index, axis in enumerate(device.axes) if axis.only_with.choice == choice]
        for choice in branch.choices
    ]
    pair, random = (new_game(game, 16), new_game(game, 16)), np.random.default_rng(4)
    for _ in range(40):
        (act,) = random_acts(game, options, 16, random)
        (other,) = random_acts(game, options, 16, random)
        for lane, choice in enumerate(act.choices[:, 0]):
            for axis in counting[choice]:
                other.axes[lane, axis] = act.axes[lane, axis]
        acts = (act, ActArrays(other.axes, act.choices))
        steps = [played.step([each])[0] for played, each in zip(pair, acts, strict=True)]
        assert np.array_equal(steps[0].rewards, steps[1].rewards)
        assert all(np.array_equal(*values) for values in zip(steps[0].observations, steps[1].observations, strict=True))
    assert {axis for axes in counting for axis in axes} == set(range(len(device.axes)))


@pytest.mark.parametrize(
    ("game", "changes"),
    [
        (Platform, [{"x": 100.0}, {"y": 80.0}, {"enemy_x": [[100.0, 730.0]]}, {"decisions": 3}]),
        (CatchPoint, [{"x": 0.9}, {"target_y": 0.9}, {"vx": 0.8}, {"misses": 2}, {"decisions": 3}]),
        (HardMove, [{"y": 0.9}, {"target_x": 0.9}, {"vy": 0.5}, {"decisions": 3}]),
        (Moving, [{"x": 0.9}, {"heading": 4.0}, {"speed": 1.0}, {"target_x": 0.85}, {"decisions": 3}]),
        (Sliding, [{"x": 0.9}, {"heading": 4.0}, {"speed": 1.0}, {"target_x": 0.85}, {"decisions": 3}]),
    ],
)
def test_a_picture_shows_all_that_matters(game, changes):
    pictures = []
    for state in ({}, {}, *changes):
        drawn = new_game(game)
        put(drawn, **state)
        pictures.append(drawn.draw(0).tobytes())
    assert pictures[0] == pictures[1] and len(set(pictures)) == 1 + len(changes)


@pytest.mark.parametrize("who", ["player", "keeper", "ball"])
def test_a_picture_of_goal_shows_who_is_where(who):
    game, moved = kick_off(3.0), kick_off(3.0)
    moved.fields[who]["x"] += 2.0
    assert not np.array_equal(game.draw(0), moved.draw(0))
    assert np.array_equal(game.draw(0), kick_off(3.0).draw(0))


@pytest.mark.parametrize("game", GAMES, ids=lambda game: game.name)
def test_a_forged_snapshot_is_refused(game):
    played = new_game(game, 2)
    saved = played.save()
    for field, value in (("decisions", 10**6), ("outcome", 1), ("success", True)):
        forged = np.frombuffer(saved["arenas"].tobytes(), game.arena_dtype).copy()
        forged[field] = value
        with pytest.raises(ValueError, match=field):
            played.restore(saved | {"arenas": forged.view(np.uint8).reshape(2, -1)})
