"""Platform, Catch Point, Hard Move, Moving and Sliding, to the digits of hand-worked scenarios."""

import numpy as np
import pytest

from joybridge.contract.codec import ActArrays
from joybridge.games.hybrid_suite.catch_point import CATCH, MOVE, CatchPoint
from joybridge.games.hybrid_suite.hard_move import HardMove, motions
from joybridge.games.hybrid_suite.moving import ACCELERATE, BRAKE, TURN, Moving, Sliding
from joybridge.games.hybrid_suite.platform import Platform
from joybridge.games.hybrid_suite.platform_rules import HOP, LEAP, RUN
from joybridge.games.hybrid_suite.suite_game import GOING, TERMINATED, TRUNCATED
from tests.support.hybrid_games import NEAR, body, close, decide, new_game, put

# --------------------------------------------------------------------------------------------------------- platform

SOLUTION = [
    (HOP, 300.0, 114.717506, 144),
    (RUN, 5.0, 160.861933, 20),
    (RUN, 0.0, 223.957179, 20),
    (HOP, 720.0, 491.631359, 144),
    (HOP, 300.0, 606.348865, 144),
    (LEAP, 250.0, 703.607484, 104),
    (RUN, 5.0, 749.751912, 20),
    (HOP, 720.0, 1017.426091, 144),
    (RUN, 5.0, 1035.0, 12),
]
MOVES = ["run", "hop", "leap"]


def test_a_run_lasts_a_second_and_speeds_up_to_the_limit():
    game = new_game(Platform, noise=0.0)
    assert decide(game, RUN, run=30.0) == (pytest.approx(0.0652029, abs=5e-8), GOING)
    close([body(game, "x"), body(game, "vx"), *game.fields["enemy_x"][0]], [67.485, 69.3, 201.5, 730.0])
    assert game.fields["ticks"][0] == 20
    expected = [0.082924, 0.693, 0.194686, 0, 0.909091, 1, 0.957447, 0, 0]
    close(np.concatenate(game.observations(), axis=1)[0], expected)


def test_nine_decisions_reach_the_goal_with_a_return_of_1():
    game = new_game(Platform, noise=0.0)
    total = 0.0
    for move, strength, x, ticks in SOLUTION:
        reward, outcome = decide(game, move, **{MOVES[move]: strength})
        close([body(game, "x"), game.fields["ticks"][0]], [x, ticks])
        total += reward
    assert outcome == TERMINATED and body(game, "success") and total == pytest.approx(1.0, abs=1e-12)
    assert reward == pytest.approx(0.016980, abs=NEAR)


def test_a_leap_into_an_enemy_ends_the_episode():
    game = new_game(Platform, noise=0.0)
    assert decide(game, LEAP, leap=430.0) == (pytest.approx(0.082625, abs=NEAR), TERMINATED)
    close([body(game, name) for name in ("x", "y", "vx", "vy")], [85.516648, 59.593, 12.896670, -15.67], 5e-6)
    assert game.fields["ticks"][0] == 84 and not body(game, "success")


def test_a_jump_that_is_too_short_falls_into_the_gap():
    game = new_game(Platform, noise=0.0)
    decide(game, RUN, run=30.0)
    assert decide(game, HOP, hop=720.0) == (pytest.approx(0.258622, abs=NEAR), TERMINATED)
    close([body(game, "x"), body(game, "y"), game.fields["ticks"][0]], [335.159180, 39.748, 144])


def test_an_episode_ends_in_the_tick_that_reaches_the_goal():
    game = new_game(Platform, noise=0.0)
    put(game, x=1000.0, vx=60.0)
    assert decide(game, RUN, run=30.0) == (pytest.approx(0.033816, abs=NEAR), TERMINATED)
    assert game.fields["ticks"][0] == 10 and body(game, "success")


def test_noise_acts_as_in_the_original():
    """The normal numbers of RandomState(0), which the original drew, come out of the stream."""
    game, random = new_game(Platform), np.random.RandomState(0)
    drawn = random.normal(size=game.streams.values.shape[1] // 2)
    pairs = np.stack([1.0 - np.exp(-drawn * drawn / 2), np.where(drawn < 0.0, 0.5, 0.0)], axis=1)
    game.streams.values[0], game.streams.cursor[0] = pairs.ravel(), 0
    decide(game, RUN, run=30.0)
    close(body(game, "x"), 67.479388497, 1e-9)
    close([game.fields["enemy_x"][0, 0], game.fields["enemy_v"][0, 0]], [201.546559514, -29.960842990], 1e-9)
    reward, _ = decide(game, RUN, run=15.0)
    close([body(game, "x"), reward], [137.479388497, 0.067632850], 1e-9)


def test_who_stands_still_runs_out_of_time_after_200_decisions():
    game = new_game(Platform, noise=0.0)
    put(game, enemy_x=[[230.0, 730.0]], enemy_v=0.0)
    outcomes = [decide(game, RUN, run=0.0)[1] for _ in range(200)]
    assert outcomes == [GOING] * 199 + [TRUNCATED]


# --------------------------------------------------------------------------------------------- catch point, hard move


def test_a_particle_drifts_while_it_catches_and_a_miss_is_counted():
    game = new_game(CatchPoint)
    put(game, x=0.0, y=0.0, target_x=0.5, target_y=0.5)
    for act, axes, v, p, reward, misses in [
        (MOVE, {"direction": 0.25}, 0.141421, 0.014142, -0.472115729, 0),
        (MOVE, {"direction": 0.25}, 0.247487, 0.038891, -0.425243254, 0),
        (CATCH, {"direction": 0.9}, 0.185616, 0.057452, -0.391696711, 1),
    ]:
        assert decide(game, act, **axes) == (pytest.approx(reward, abs=1e-8), GOING)
        close([body(game, name) for name in ("vx", "vy", "x", "y", "misses")], [v, v, p, p, misses])


def test_a_catch_within_reach_pays_and_ends():
    game = new_game(CatchPoint)
    put(game, x=0.1, y=0.0, target_x=0.25, target_y=0.1)
    assert decide(game, CATCH) == (pytest.approx(19.9675), TERMINATED) and body(game, "success")


def test_the_decision_after_eleven_misses_ends_the_episode():
    game = new_game(CatchPoint)
    put(game, x=0.0, y=0.0, target_x=1.0, target_y=0.0)
    assert [decide(game, CATCH) for _ in range(12)] == [(-1.0, GOING)] * 11 + [(0.0, TERMINATED)]
    assert not body(game, "success")


@pytest.mark.parametrize("limit", [25, 30])
def test_a_particle_that_wanders_is_cut_off(limit):
    game = new_game(CatchPoint, decisions=str(limit))
    put(game, x=0.0, y=0.0, target_x=1.0, target_y=1.0)
    outcomes = [decide(game, MOVE, direction=-0.75)[1] for _ in range(limit)]
    assert outcomes == [GOING] * (limit - 1) + [TRUNCATED]


def test_actuators_add_up_and_power_may_be_negative():
    game = new_game(HardMove, actuators="4", choice="joint")
    put(game, x=0.0, y=0.0, target_x=0.5, target_y=-0.5)
    assert decide(game, 8, power=1.0)[0] == pytest.approx(-0.486057864, abs=1e-8)
    close([body(game, "vx"), body(game, "vy")], [0.141421, 0.0])
    assert decide(game, 12, power=-0.5)[0] == pytest.approx(-0.475613763, abs=1e-8)
    close([body(game, "vx"), body(game, "vy")], [0.035355, -0.070711])
    assert decide(game, 15, power=1.0)[0] == pytest.approx(-0.467862718, abs=1e-8)


MOVES_OF_N = [
    ("6", (0.3, 0.3, 0.35, 0.45), 48, 1.0, 19.978798004, TERMINATED, None),
    ("8", (-0.5, 0.2, 0.5, 0.2), 131, 0.7, -0.981875182, GOING, (0.091461, -0.091461)),
    ("10", (0.0, 0.0, 0.4, 0.0), 769, 1.0, -0.147319, GOING, (0.161786, 0.0)),
]


@pytest.mark.parametrize(("actuators", "places", "choice", "power", "reward", "outcome", "v"), MOVES_OF_N)
def test_more_actuators_move_in_more_directions(actuators, places, choice, power, reward, outcome, v):
    game = new_game(HardMove, actuators=actuators, choice="joint")
    put(game, **dict(zip(("x", "y", "target_x", "target_y"), places, strict=True)))
    assert decide(game, choice, power=power) == (pytest.approx(reward, abs=NEAR), outcome)
    if v:
        close([body(game, "vx"), body(game, "vy")], v)


def test_buttons_are_the_bits_of_the_joint_choice():
    random = np.random.default_rng(3)
    pressed = random.integers(2, size=(50, 6)).astype(np.int32)
    power = random.uniform(-1.0, 1.0, (50, 1)).astype(np.float32)
    numbers = np.array([[int("".join(map(str, row)), 2)] for row in pressed], np.int32)
    games = [new_game(HardMove, 50, actuators="6", choice=choice) for choice in ("buttons", "joint")]
    steps = [game.step([ActArrays(power, act)])[0] for game, act in zip(games, (pressed, numbers), strict=True)]
    assert all(np.array_equal(*pair) for pair in zip(steps[0].observations, steps[1].observations, strict=True))
    assert np.array_equal(steps[0].rewards, steps[1].rewards)


def test_combinations_of_actuators_are_redundant():
    counts = [len(np.unique(np.round(motions(n), 9), axis=0)) for n in (4, 6, 8, 10)]
    assert counts == [9, 19, 81, 211]
    assert motions(4)[8] == pytest.approx([0.707107, 0.0], abs=NEAR)


# ------------------------------------------------------------------------------------------------ moving and sliding


def driver(game, x, y, heading, target_x, target_y):
    game = new_game(game)
    put(game, x=x, y=y, heading=heading, course=heading, speed=0.0, target_x=target_x, target_y=target_y)
    return game


DRIVE = [(ACCELERATE, {"accelerate": 0.8}), (TURN, {"turn": 0.5}), (ACCELERATE, {"accelerate": 0.4}), (BRAKE, {})]


def test_in_moving_the_agent_goes_where_it_looks():
    game = driver(Moving, 0.0, 0.0, 0.0, 0.5, 0.0)
    rewards, places, speeds = [], [], []
    for act, axes in DRIVE:
        rewards.append(decide(game, act, **axes)[0])
        places.append([body(game, "x"), body(game, "y")])
        speeds.append(body(game, "speed"))
    close(places, [[0.002, 0.0], [0.003414, 0.001414], [0.005536, 0.003536], [0.007303, 0.005303]])
    close(rewards, [0.001, 0.000412200, 0.001110694, 0.000751866], 1e-8)
    close(speeds, [0.4, 0.4, 0.6, 0.5])


def test_in_sliding_a_turn_changes_the_course_of_the_next_push_only():
    game = driver(Sliding, 0.0, 0.0, 0.0, 0.5, 0.0)
    rewards, places, speeds = [], [], []
    for act, axes in DRIVE:
        rewards.append(decide(game, act, **axes)[0])
        places.append([body(game, "x"), body(game, "y")])
        speeds.append(body(game, "speed"))
    close(places, [[0.002, 0.0], [0.004, 0.0], [0.006707, 0.000707], [0.008930, 0.001288]])
    close(rewards, [0.001, 0.001, 0.001706600, 0.001222156], 1e-8)
    close(speeds[2:], [0.559587, 0.459587])
    close(body(game, "course"), 0.255495)


def test_a_stop_in_the_target_is_a_success():
    game = driver(Moving, 0.47, 0.0, 0.0, 0.5, 0.0)
    assert decide(game, ACCELERATE, accelerate=0.1) == (pytest.approx(-0.00075, abs=1e-8), GOING)
    close(body(game, "x"), 0.47025)
    assert decide(game, BRAKE) == (pytest.approx(0.999), TERMINATED) and body(game, "success")


def test_a_turn_at_rest_in_the_target_is_a_success_at_once():
    game = driver(Moving, 0.0, 0.0, 1.0, 0.05, 0.0)
    assert decide(game, TURN, turn=0.2) == (pytest.approx(0.999), TERMINATED)


@pytest.mark.parametrize(("x", "reward", "outcome"), [(0.999, -1.0, TERMINATED), (0.9975, -0.0035, GOING)])
def test_the_field_ends_beyond_1(x, reward, outcome):
    game = driver(Moving, x, 0.0, 0.0, -0.5, 0.0)
    assert decide(game, ACCELERATE, accelerate=1.0) == (pytest.approx(reward), outcome)


def test_five_brakes_do_not_stop_a_speed_of_a_half_but_six_do():
    game = driver(Moving, 0.0, 0.0, 0.0, 0.5, 0.0)
    decide(game, ACCELERATE, accelerate=1.0)
    for _ in range(5):
        decide(game, BRAKE)
    assert 0.0 < body(game, "speed") < 1e-15
    decide(game, BRAKE)
    assert body(game, "speed") == 0.0


@pytest.mark.parametrize("game", [Moving, Sliding])
def test_the_decision_after_200_ends_as_a_failure(game):
    game = driver(game, 0.0, 0.0, 0.0, 0.5, 0.5)
    ends = [decide(game, BRAKE) for _ in range(201)]
    assert [outcome for _, outcome in ends] == [GOING] * 200 + [TERMINATED] and ends[-1][0] == -1.0
