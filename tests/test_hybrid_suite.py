"""The hybrid-action suite: the rules of each task to the digits of hand-worked scenarios, ends, options and pictures.

That the games keep the contract over a real server, snapshots included, is the conformance kit's business, in
test_check.py.
"""

import hashlib
import math

import numpy as np
import pytest

from joybridge.contract.codec import ActArrays
from joybridge.games.hybrid_suite import soccer
from joybridge.games.hybrid_suite.catch_point import CATCH, MOVE, CatchPoint
from joybridge.games.hybrid_suite.goal import Goal, HardGoal
from joybridge.games.hybrid_suite.hard_move import HardMove, motions
from joybridge.games.hybrid_suite.moving import ACCELERATE, BRAKE, TURN, Moving, Sliding
from joybridge.games.hybrid_suite.platform import Platform
from joybridge.games.hybrid_suite.platform_rules import HOP, LEAP, RUN
from joybridge.games.hybrid_suite.soccer import KICK, LEFT, RIGHT
from joybridge.games.hybrid_suite.suite_game import GOING, TERMINATED, TRUNCATED
from tests.support.measured import interpreted

GAMES = [Platform, Goal, HardGoal, CatchPoint, HardMove, Moving, Sliding]
NEAR = 6e-7  # half a unit of the scenarios' last digit


def new_game(game, arenas=1, seed=5, noise=None, first_arena=0, **options):
    chosen = {option.name: option.default_choice for option in game.options} | options
    return game(chosen, {} if noise is None else {"noise": noise}, arenas, first_arena, seed)


def decide(game, choice, **axes):
    """Let the first arena decide; return its reward and its outcome. The episode is left as it ended."""
    device = type(game).describe(game_options(game)).behaviors[0].device
    values = np.zeros((1, len(device.axes)), np.float32)
    for index, axis in enumerate(device.axes):
        values[0, index] = axes.pop(axis.name, 0.0)
    assert not axes
    rewards = np.zeros(1)
    game.decide(ActArrays(values, np.array([np.atleast_1d(choice)], np.int32)), rewards)
    return float(rewards[0]), int(game.fields["outcome"][0])


def game_options(game):
    options = {option.name: option.default_choice for option in game.options}
    if isinstance(game, HardMove):
        options |= {"actuators": str(int(math.log2(len(game.motions)))), "choice": "joint"}
    return options


def put(game, **fields):
    for name, value in fields.items():
        game.fields[name] = value


def body(game, name):
    return game.fields[name][0]


def random_acts(game, options, arenas, random):
    device = game.describe(options).behaviors[0].device
    axes = [random.uniform(axis.low, axis.high, arenas) for axis in device.axes]
    choices = [random.integers(len(branch.choices), size=arenas) for branch in device.branches]
    return [ActArrays(np.stack(axes, 1).astype(np.float32), np.stack(choices, 1).astype(np.int32))]


def close(values, expected, tolerance=NEAR):
    np.testing.assert_allclose(values, expected, rtol=0.0, atol=tolerance)


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


# ------------------------------------------------------------------------------------------------ goal and hard goal


def kick_off(y, game=Goal, **options):
    game = new_game(game, noise=0.0, **options)
    soccer.place(game.arenas[0], y)
    return game


def state(game, *bodies):
    return [float(game.fields[each][0][field]) for each in bodies for field in ("x", "y", "vx", "vy")]


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


# --------------------------------------------------------------------------------------- determinism, ends, pictures

GOLDEN = {
    "platform": "c9d3ec58035f78a9",
    "goal": "a534350b6135dc73",
    "hard_goal": "74e2b81990ce0f7a",
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


def test_compiled_and_interpreted_rules_give_the_same_bytes():
    assert interpreted("tests.support.digest", "tests.test_hybrid_suite").split()[-1] == digest_of_a_short_run()


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
        assert step.rewards[5] == own.rewards[0]
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
