"""Goal and Hard Goal, to the digits of hand-worked scenarios."""

import numpy as np
import pytest

from joybridge.contract.codec import ActArrays
from joybridge.games.hybrid_suite import soccer
from joybridge.games.hybrid_suite.goal import Goal, HardGoal
from joybridge.games.hybrid_suite.soccer import KICK, LEFT, RIGHT
from joybridge.games.hybrid_suite.suite_game import GOING, TERMINATED
from tests.support.hybrid_games import NEAR, body, close, decide, kick_off, new_game, put, state


def test_a_kick_and_a_shot_score():
    game = kick_off(-4.5)
    assert decide(game, KICK, kick_x=2.0, kick_y=7.0) == (0.0, GOING) and game.fields["ticks"][0] == 68
    close(state(game, "player"), [3.320590, 0.674174, 0.011209, 0.038397])
    close(state(game, "keeper"), [9.381729, 0.441630, -0.030406, 0.009975])
    close(state(game, "ball"), [3.531209, 2.254479, 0.001786, 0.005804])
    close([game.fields["player"]["angle"][0], game.fields["keeper"]["angle"][0]], [1.286772, 2.824590])
    assert decide(game, LEFT, left=5.0) == (50.0, TERMINATED)
    assert game.fields["ticks"][0] == 54 and body(game, "success")
    close(state(game, "ball"), [20.006146, 6.427206, 0.036268, 0.009186])
    close(state(game, "player", "keeper")[:2] + state(game, "keeper")[:2], [7.075289, 2.927459, 8.680898, 3.741105])


def test_a_shot_straight_ahead_has_no_noise_and_passes_the_keeper():
    game = kick_off(6.0)
    put(game, noise=1.0)
    decide(game, RIGHT, right=6.0)
    assert game.fields["ball"]["vy"][0] == 0.0
    game = kick_off(6.0)
    assert decide(game, RIGHT, right=6.0) == (50.0, TERMINATED) and game.fields["ticks"][0] == 39
    close(state(game, "ball"), [20.106036, 5.540243, 0.109589, 0.0])
    close(state(game, "keeper")[:2], [17.216998, 3.072099])


@pytest.mark.parametrize(
    ("y", "reward", "ticks", "ball"),
    [(-7.0, -7.726476, 12, [12.273524, -2.478142]), (7.0, -6.596375, 14, None)],
)
def test_a_ball_that_the_keeper_catches_costs_its_distance(y, reward, ticks, ball):
    game = kick_off(3.0)
    start = [-1, 0.2, 0, 0, -0.047393, 0.45, 0.055, 0, 0, 0.952607, -0.841770, 0.184177, 0, 0]
    close(np.concatenate(game.observations(), axis=1)[0], [*start, -0.988936, 0.148340, -0.333333])
    assert decide(game, LEFT, left=y) == (pytest.approx(reward, abs=NEAR), TERMINATED)
    assert game.fields["ticks"][0] == ticks and not body(game, "success")
    if ball:
        close(state(game, "ball")[:2], ball)


def test_a_kick_goes_along_the_diagonal_in_the_original_and_where_it_aims_if_corrected():
    game = kick_off(6.0)
    assert decide(game, KICK, kick_x=4.0, kick_y=-9.0) == (0.0, GOING) and game.fields["ticks"][0] == 46
    close(state(game, "player")[:2] + state(game, "keeper")[:2], [4.117343, 4.682250, 10.951314, 2.398023])
    close(state(game, "ball"), [5.300280, 3.656365, 0.013935, -0.006967])
    close(game.fields["player"]["angle"][0], -0.630693)
    game = kick_off(6.0, rules="corrected")
    assert decide(game, KICK, kick_x=4.0, kick_y=5.0) == (0.0, GOING) and game.fields["ticks"][0] == 40
    close(state(game, "ball")[:2], [5.195876, 4.624405])


def test_the_hundredth_decision_ends_an_episode_and_nothing_moves():
    game = kick_off(0.0)
    put(game, decisions=99)
    before = state(game, "player", "keeper", "ball")
    assert decide(game, KICK, kick_x=9.0) == (pytest.approx(-18.4), TERMINATED)
    assert state(game, "player", "keeper", "ball") == before


@pytest.mark.parametrize(
    ("rules", "costs"), [("original", {8.0: 0.99, -8.0: 15.01}), ("corrected", {8.0: 0.99, -8.0: 0.99})]
)
def test_a_miss_below_the_goal_costs_more_in_the_original(rules, costs):
    for y, cost in costs.items():
        game = kick_off(0.0, rules=rules)
        put(game, decisions=99)
        game.fields["ball"]["x"], game.fields["ball"]["y"] = 20.3, y
        assert decide(game, LEFT)[0] == pytest.approx(-cost)


def test_the_noise_of_kicks_acts_as_in_the_original():
    game = new_game(Goal)
    random = np.random.RandomState(0)
    soccer.place(game.arenas[0], -15.0 + 30.0 * random.random_sample())
    close(state(game, "player")[:2], [0.0, 1.464405])
    game.streams.values[0], game.streams.cursor[0] = random.random_sample(game.streams.values.shape[1]), 0
    reward, outcome = decide(game, LEFT, left=-5.5)
    assert outcome == TERMINATED and game.fields["ticks"][0] == 12
    close([reward, *state(game, "ball")[:2]], [-7.739153153, 12.260847, -2.377933])
    assert reward == pytest.approx(-7.739153153, abs=1e-9)


HARD_SHOTS = {  # choice, place on its axis -> reward, ticks, ball
    (5, -0.28): (-6.646151023, 14, [13.353849, 5.540568]),
    (5, 0.5): (-6.646151023, 14, [13.353849, 4.906875]),
    (8, 0.3): (-7.193725901, 13, [12.806274, 2.999228]),
    (8, -0.9): (-7.193725901, 13, [12.806274, 2.999228]),  # the third part is a point
}


@pytest.mark.parametrize(("choice", "place"), HARD_SHOTS)
def test_shots_of_hard_goal_aim_at_their_parts(choice, place):
    reward, ticks, ball = HARD_SHOTS[choice, place]
    game = kick_off(6.0, HardGoal)
    name = HardGoal.actions()[choice]
    assert decide(game, choice, **{name: place}) == (pytest.approx(reward, abs=1e-8), TERMINATED)
    assert game.fields["ticks"][0] == ticks
    close(state(game, "ball")[:2], ball)


def test_each_axis_of_hard_goal_moves_its_own_shot_from_high_to_low():
    game = new_game(HardGoal)
    for choice in range(1, 11):
        axes = np.zeros((1, 12), np.float32)
        axes[0, 1 + choice] = 0.5
        action, _, y = game.aims(ActArrays(axes, np.array([[choice]], np.int32)))
        assert action[0] == (LEFT if choice < 6 else RIGHT)
        close(y[0] / soccer.GOAL_HALF, [-0.9, -0.5, 0.2, 0.3, 0.7][(choice - 1) % 5])


def test_the_kick_of_hard_goal_is_that_of_goal():
    game = kick_off(6.0, HardGoal)
    decide(game, 0, kick_x=4.0, kick_y=3.0)
    close(state(game, "ball")[:2], [5.300280, 3.656365])
