"""The complete Beastly Rivals as the service runs it: sensors, waiting, rewards, ends, scripts, snapshots, bytes."""

import hashlib
import math

import numpy as np
import pytest

from joybridge.contract.codec import ActArrays
from joybridge.contract.sharding import rows_of
from joybridge.contract.spec import check_spec
from joybridge.games.beastly_rivals_full.ball import throw
from joybridge.games.beastly_rivals_full.game import BeastlyRivalsFull
from joybridge.games.beastly_rivals_full.geometry import SEATS
from joybridge.games.beastly_rivals_full.scripts import FLEE, SCRIPTS, play
from joybridge.games.beastly_rivals_full.state import DECISION_TICKS, HUNT, MAX_DECISIONS, START
from joybridge.games.locomotion import LOCOMOTIONS

OPTIONS = {option.name: option.default_choice for option in BeastlyRivalsFull.options} | {"locomotion": "axes"}
SURVIVAL, KILL, DEATH, HUMILIATION, PLACEMENT, BALL = range(6)
SHORT = {"pauses": "short", "lives": "0"}  # matches of some 100 decisions
END = MAX_DECISIONS * DECISION_TICKS


def new_game(arenas=3, first_arena=0, seed=5, parameters=None, **options):
    return BeastlyRivalsFull({**OPTIONS, **options}, parameters or {}, arenas, first_arena, seed)


def device_of(**options):
    (behavior,) = BeastlyRivalsFull.describe({**OPTIONS, **options}).behaviors
    return behavior.device


def rest(lanes):
    return ActArrays(np.zeros((lanes, 2), np.float32), np.zeros((lanes, 1), np.int32))


def random_act(device, lanes, random):
    axes = [random.uniform(axis.low, axis.high, lanes) for axis in device.axes]
    choices = [random.integers(len(branch.choices), size=lanes) for branch in device.branches]
    return ActArrays(np.stack(axes, 1).astype(np.float32), np.stack(choices, 1).astype(np.int32))


def play_at_random(game, decisions, seed=3, **options):
    """Yield the steps of random play."""
    device, random = device_of(**options), np.random.default_rng(seed)
    for _ in range(decisions):
        (step,) = game.step([random_act(device, len(game.arenas) * game.agents, random)])
        yield step


def play_beside_scripts(game, decisions):
    """Yield the steps of random play of each first player, as its own, beside the three scripts."""
    arenas, random = len(game.arenas), np.random.default_rng(3)
    scripts = np.tile(np.arange(4, dtype=np.int32), arenas)
    for _ in range(decisions):
        act, own = rest(4 * arenas), random_act(device_of(), arenas, random)
        act.axes[::4], act.choices[::4], act.scripts = own.axes, own.choices, scripts
        (step,) = game.step([act])
        yield rows_of(step, np.arange(0, 4 * arenas, 4))


def digest(steps):
    """Return the bytes of observations, rewards and flags of steps."""
    content = hashlib.sha256()
    for step in steps:
        for array in [*step.observations, step.rewards, step.terminated, step.truncated, step.deciding]:
            content.update(array.tobytes())
    return content.hexdigest()


def hunted(game, arena, i):
    """Put the beast of an arena right before its player i, who carries the ball."""
    match = game.arenas[arena]
    match.phase, match.phase_tick, match.carrier, match.target = HUNT, 0, i, i
    player, beast = match.players[i], match.beast
    beast.x, beast.z, beast.fx, beast.fz, beast.gx, beast.gz = player.x, player.z - 0.7, 0.0, 1.0, 0.0, 1.0


# ------------------------------------------------------------------------------------------- spec and observations


@pytest.mark.parametrize("players", [2, 4, 8])
@pytest.mark.parametrize("locomotion", LOCOMOTIONS)
def test_spec_is_well_formed_and_observations_keep_to_its_bounds(players, locomotion):
    options = {"players": str(players), "locomotion": locomotion, **SHORT}
    spec = BeastlyRivalsFull.describe({**OPTIONS, **options})
    check_spec(spec)
    (behavior,) = spec.behaviors
    assert behavior.agents_per_arena == players and spec.max_episode_decisions == 6000
    assert list(behavior.device.branches[-1].choices) == ["none", "click", "double_click"]
    assert (behavior.sensors[-1].name == "heading") == (locomotion == "steer")
    game = new_game(4, parameters={"beast_speed": 1.5, "beast_turning": 2.0, "ball_speed": 2.0}, **options)
    for step in play_at_random(game, 150, **options):
        for sensor, values in zip(behavior.sensors, step.observations, strict=True):
            assert values.shape == (4 * players, *sensor.shape) and values.dtype == np.float32
            low, high = (np.array(ends, np.float32) for ends in (sensor.low, sensor.high))
            if len(low) > 1:
                low, high = low.reshape(sensor.shape), high.reshape(sensor.shape)
            assert (values >= low).all() and (values <= high).all(), sensor.name


def test_observation_has_its_values_in_order_and_units():
    game = new_game(1, players="2", seed=1)
    match = game.arenas[0]
    for j, values in enumerate(
        (
            {"x": 4.7, "z": -9.4, "vx": 15, "vz": -3, "fx": 0, "fz": 1, "lives": 1, "kills": 2, "has_goal": True,
             "goal_x": 9.4, "goal_z": 0, "throw_tick": 700, "blink_ready": 975, "pointer_x": 23.5, "pointer_z": 4.7,
             "pointer_vx": 60, "pointer_vz": -120, "touching": True},
            {"x": 23.5, "z": 4.7, "vx": 3, "vz": 0, "fx": 1, "fz": 0, "lives": 2, "kills": -1, "pass_to": 0,
             "pointer_x": 0, "pointer_z": 0},
        )
    ):  # fmt: skip
        for name, value in values.items():
            match.players[j][name] = value
    for name, value in {
        "x": 0,
        "z": 47,
        "fx": 1,
        "fz": 0,
        "gx": 0,
        "gz": -1,
        "speed": 37.5,
        "turning": 90,
        "boost_tick": 681,
    }.items():
        match.beast[name] = value
    match.phase, match.tick, match.carrier, match.target, match["last"] = HUNT, 660, 0, 0, 1
    match.hold, match.charge = 1500, 7.5
    own, pointer, rivals, beast, ball, phase = (sensor[0] for sensor in game.observe()[0].observations)
    wanted = [0.1, -0.2, 1, -0.2, 0, 1, 0.5, 0.2, 1, 1, 0, 40 / 30, 0.42, 0, 0.1, 0.2]
    assert own == pytest.approx(wanted)
    assert pointer == pytest.approx([0.5, 0.1, 0.5, -1, 0, 1])
    assert rivals[0] == pytest.approx([1, 1, 0.4, 0.3, 0.2, 0, 1, 0, 1, -0.1, 0, 0, 1, 1, 1, 0, 0])
    assert beast == pytest.approx([-0.1, 1.2, 0, 1, 1, 0, 0, -1, 0.5, 0.25, 1, 0.2, 1])
    assert ball == pytest.approx([1, 0, 0, 0, 8 / 28, 0, 2, 0.5, 0, 0])
    assert phase == pytest.approx([0, 1, 0, 0, 0, 660 / END, 1])
    other = [sensor[1] for sensor in game.observe()[0].observations]
    assert other[0][10] == 1 and other[4][8] == 1 and other[1][4:].tolist() == [0, 0]


def test_seats_are_random():
    seats = new_game(64, players="8", **SHORT).fields["players"]["seat"]
    assert all(len(set(row)) == 8 for row in seats.tolist()) and len(np.unique(seats[:, 0])) == 8


def test_rivals_are_seen_from_the_pointer_the_nearest_living_one_first():
    game = new_game(1, players="4")
    match, places = game.arenas[0], {1: (10, 0), 2: (0, -5), 3: (0, 2)}
    match.players[0].pointer_x = match.players[0].pointer_z = 0.0
    for k, (x, z) in places.items():
        match.players[k].x, match.players[k].z = x, z
    match.players[3].alive = False

    def seen():
        return game.observe()[0].observations[2][0].astype(float)

    assert (seen()[:, 15:] * 14.4).round(4).tolist() == [[0, -5], [10, 0], [0, 2]]
    assert seen()[:, 1].tolist() == [1, 1, 0]
    match.players[3].alive, match.players[1].x = True, 47.0
    match.players[2].alive, match.players[2].out = False, True
    assert (seen()[:, 15:] * 14.4).round(4).tolist() == [[0, 2], [28.8, 0], [0, 0]]
    assert (seen()[2] == 0).all()


# --------------------------------------------------------------------------------------- device, decisions, ends


def test_a_click_counts_where_the_pointer_was_before_it_moved():
    game = new_game(1, players="2")
    match = game.arenas[0]
    place = float(match.players[0].pointer_x)
    match.players[0].x += 10.0  # away from its pointer
    (step,) = game.step([ActArrays(np.array([[1.0, 0.0], [0.0, 0.0]], np.float32), np.array([[1], [0]], np.int32))])
    player = game.arenas[0].players[0]
    assert player.has_goal and player.goal_x == pytest.approx(place)
    assert player.pointer_x == pytest.approx(min(place + 14.4, 47.0)) and step.observations[1][0, 2] == 1.0


def test_who_died_waits_until_its_revival_and_its_rewards_wait_with_it():
    game = new_game(2, players="2", pauses="short", rewards="separate")
    hunted(game, 1, 0)
    (step,) = game.step([rest(4)])
    assert step.deciding.tolist() == [True, True, False, True] and not step.rewards[2].any()
    assert game.observe()[0].deciding.tolist() == step.deciding.tolist()
    pointer = game.arenas[1].players[0].pointer_x
    decisions = 0
    while not step.deciding[2]:
        assert not step.rewards[2].any()
        (step,) = game.step([ActArrays(np.ones((4, 2), np.float32), np.ones((4, 1), np.int32))])
        decisions += 1
    assert decisions == 8 and game.arenas[1].players[0].pointer_x == pointer  # 50 ticks
    assert step.rewards[2].tolist() == pytest.approx([0.04, 0.0, -1.0, -1.0, 0.0, 0.0])  # alive in 4 of 6 ticks


def test_the_end_of_a_match_ends_the_episode_of_all_its_lanes_at_once():
    game = new_game(2, players="3", lives="0", pauses="short")
    hunted(game, 1, 2)
    (step,) = game.step([rest(6)])
    assert not step.terminated.any() and not step.deciding[5]
    game.step([rest(6)])
    hunted(game, 1, 0)
    (step,) = game.step([rest(6)])
    assert step.terminated.tolist() == [False] * 3 + [True] * 3 and not step.truncated.any()
    assert step.ended.tolist() == [3, 4, 5] and step.deciding.all()
    metrics = dict(
        zip([one.name for one in BeastlyRivalsFull.describe(OPTIONS).behaviors[0].metrics], step.metrics.T, strict=True)
    )
    assert metrics["place"].tolist() == [2, 1, 3] and metrics["won"].tolist() == [0, 1, 0]
    assert metrics["deaths"].tolist() == [1, 0, 1] and metrics["kills"].tolist() == [-1, 0, -1]
    assert metrics["survival"].tolist() == pytest.approx([2 + 1 / 6, 2 + 1 / 6, 1 / 6])
    assert game.arenas[1].tick == 0 and game.arenas[1].phase == START and game.arenas[0].tick == 18


def test_at_the_limit_the_remaining_are_truncated_and_ranked_by_lives_then_kills():
    game = new_game(1, players="4", rewards="separate")
    match = game.arenas[0]
    match.phase, match.phase_tick, match.tick = HUNT, 0, END - 6
    match.players[0].out, match.players[0].alive, match.players[0].place = True, False, 4.0
    match.players[1].lives, match.players[2].lives, match.players[3].lives = 0, 2, 2
    (step,) = game.step([rest(4)])
    assert step.terminated.tolist() == [True, False, False, False]
    assert step.truncated.tolist() == [False, True, True, True]
    assert step.metrics[:, 0].tolist() == [4.0, 3.0, 1.5, 1.5] and not step.metrics[:, 1].any()
    assert step.rewards[:, PLACEMENT].tolist() == pytest.approx([0, -1 / 3, 2 / 3, 2 / 3])


def test_zero_sum_rewards_are_differences_to_the_mean_of_those_who_play_and_add_up_to_zero():
    games = [new_game(8, rewards=rewards, **SHORT) for rewards in ("zero_sum", "separate")]
    totals, kept, playing = np.zeros((2, 8, 4, 6)), np.zeros((2, 8, 4, 6)), np.ones((8, 4, 1), bool)
    ended = np.zeros(8, bool)
    for steps in zip(*(play_at_random(game, 700) for game in games), strict=True):
        earned = np.stack([game.fields["players"]["earned"][:, :4] for game in games])
        gained = np.stack([step.rewards.reshape(8, 4, 6) for step in steps]) + earned - kept
        gained[:, ended] = 0.0
        totals += gained
        compared = np.repeat(playing, 6, axis=2)
        compared[:, :, PLACEMENT] = True  # also those who are out
        own = np.where(compared, gained[1], 0.0)
        others = compared.sum(axis=1, keepdims=True) - 1
        mean = (own.sum(axis=1, keepdims=True) - own) / np.maximum(others, 1)
        assert gained[0] == pytest.approx(np.where(compared, own - mean, 0.0), abs=1e-4)
        ended |= steps[0].ends.reshape(8, 4).any(axis=1)
        kept, playing = earned.copy(), ~games[0].fields["players"]["out"][:, :4, None]
    assert ended.all()
    assert totals[0].sum(axis=1) == pytest.approx(np.zeros((8, 6)), abs=1e-3)
    assert np.sort(totals[1, :, :, PLACEMENT]) == pytest.approx(np.tile([-1, -1 / 3, 1 / 3, 1], (8, 1)), abs=1e-6)
    assert totals[1, :, :, DEATH].sum(axis=1).tolist() == [-3.0] * 8


# ----------------------------------------------------------------------------------------------------- the scripts


def test_scripts_play_the_lanes_that_are_given_to_them_without_pointer_and_clicks():
    game = new_game(6, **SHORT)
    ends = sum(len(step.ended) for step in play_beside_scripts(game, 1500))
    players = game.fields["players"]
    assert ends > 6 and not players["clicks"][:, 1:].any() and players["clicks"][:, 0].any()
    pointers = np.stack([players["pointer_x"], players["pointer_z"]], axis=-1)
    assert (pointers == SEATS[players["seat"]])[:, 1:4].all()


def test_a_pointer_that_is_steered_keeps_its_heading_while_a_script_plays():
    game = new_game(1, locomotion="steer", **SHORT)
    act = random_act(device_of(locomotion="steer"), 4, np.random.default_rng(1))
    act.scripts = np.array([0, FLEE, 0, FLEE], np.int32)
    before = game.headings()
    game.step([act])
    assert (game.headings() != before).tolist() == [True, False, True, False]


def commanded(script, **state):
    """Return the match of two and player 0, on whom the beast looks, after one command of a script."""
    game = new_game(1, players="2")
    match = game.arenas[0]
    match.phase, match.phase_tick, match.carrier, match.target = HUNT, 0, 0, 0
    player, rival = match.players[0], match.players[1]
    player.x, player.z, player.fx, player.fz = 0.0, 20.0, 0.0, 1.0
    rival.x, rival.z = 20.0, 20.0
    for name, value in state.items():
        (match if name in match.dtype.names else match.beast)[name] = value
    play(match, 0, 1 + list(SCRIPTS).index(script), game.rules)
    return match, player


def test_flee_runs_from_the_beast_and_blinks_if_it_is_near():
    _, player = commanded("flee")
    assert (player.goal_x, player.goal_z) == pytest.approx((0.0, 35.0)) and player.blink_tick == 0
    match, player = commanded("flee", z=14.0)
    assert (player.blink_tick, player.blink_x, player.blink_z) == (match.tick + 16, 0.0, -14.0)
    _, player = commanded("flee", target=1, carrier=1)
    assert (player.goal_x, player.goal_z) == pytest.approx(tuple(SEATS[player.seat]))


def test_at_once_passes_as_soon_as_it_has_the_ball():
    _, player = commanded("at_once")
    assert (player.pass_to, player.pass_x, player.pass_z) == (1, 20.0, 20.0)
    _, player = commanded("at_once", carrier=-1)
    assert player.pass_to == -1 and (player.goal_x, player.goal_z) == pytest.approx((0.0, 35.0))


def test_patient_stays_behind_the_beast_and_passes_at_the_last_moment_or_fully_charged():
    _, player = commanded("patient")
    assert player.pass_to == -1 and (player.goal_x, player.goal_z) == pytest.approx((0.0, -8.0))
    # The turn to the rival by 90 - 10 degrees takes 0.32 s, the wind-up 0.6 s: it passes 1.17 s before the touch.
    assert commanded("patient", z=20.0 + 1.2 - 2.0 - 11.6)[1].pass_to == 1
    assert commanded("patient", z=20.0 + 1.2 - 2.0 - 11.8)[1].pass_to == -1
    assert commanded("patient", charge=14.9)[1].pass_to == 1


def test_a_script_that_flees_never_passes():
    game, act = new_game(4, players="3", **SHORT), rest(12)
    act.scripts = np.full(12, FLEE, np.int32)
    for _ in range(400):
        game.step([act])
    assert not game.fields["players"]["passes"].any()


# -------------------------------------------------------------------------------------------- state and its bytes


@pytest.mark.parametrize("locomotion", ["axes", "steer"])
def test_an_arena_plays_the_same_game_alone_as_among_others(locomotion):
    options = {"players": "3", "locomotion": locomotion, **SHORT}
    among, device, random = new_game(5, **options), device_of(**options), np.random.default_rng(3)
    alone = [new_game(1, first_arena=i, **options) for i in range(5)]
    for _ in range(300):
        act = random_act(device, 15, random)
        (of_all,) = among.step([act])
        for i, game in enumerate(alone):
            lanes = slice(3 * i, 3 * i + 3)
            (own,) = game.step([ActArrays(act.axes[lanes], act.choices[lanes])])
            for a, b in zip(
                [*of_all.observations, of_all.rewards, of_all.deciding],
                [*own.observations, own.rewards, own.deciding],
                strict=True,
            ):
                assert a[lanes].tobytes() == b.tobytes()


def test_a_restored_game_continues_to_the_same_bytes():
    game = new_game(5, parameters={"beast_speed": 1.2}, **SHORT)
    digest(play_at_random(game, 100))
    state = {name: array.copy() for name, array in game.save().items()}
    wanted = digest(play_at_random(game, 200))
    other = new_game(5, seed=99, **SHORT)
    other.restore(state)
    assert digest(play_at_random(other, 200)) == wanted


@pytest.mark.parametrize(
    ("part", "field", "value"),
    [
        (None, "carrier", 4),
        (None, "target", -2),
        (None, "tick", -1),
        (None, "charge", math.nan),
        ("beast", "speed", 1e9),
        ("ball", "flying", True),
        ("players", "seat", 9),
        ("players", "out", True),
        ("players", "lives", 3),
    ],
)
def test_restore_refuses_a_state_that_no_match_can_be_in(part, field, value):
    game = new_game(2)
    arenas = game.arenas.copy()
    (arenas[part] if part else arenas)[field][1] = value
    state = {**game.save(), "arenas": np.frombuffer(arenas.tobytes(), np.uint8).reshape(2, -1)}
    with pytest.raises(ValueError, match=field):
        game.restore(state)


def test_every_state_of_a_match_can_be_restored():
    game, other = new_game(4, **SHORT), new_game(4, seed=8, **SHORT)
    for step in play_at_random(game, 200):
        other.restore(game.save())
        assert other.save()["arenas"].tobytes() == game.save()["arenas"].tobytes()
        assert len(step.observations) == 6


def test_reset_begins_new_matches_and_with_a_seed_the_matches_of_that_seed():
    game = new_game(5)
    first = digest(play_at_random(game, 20))
    game.reset(None, {"ball_speed": 1.5})
    assert not game.fields["tick"].any() and (game.fields["ball_speed"] == 1.5).all()
    assert digest(play_at_random(game, 20)) != first
    game.reset(5, {"ball_speed": 1.0})
    assert digest(play_at_random(game, 20)) == first


@pytest.mark.parametrize(
    ("players", "rules", "golden"),
    [
        ("2", "original", "16505d6aa9068b2fd73c41bc3630f6ed95f340ab2c87440b7dfd11c7085b7fdc"),
        ("4", "original", "d0e11b7e23a9224f70eaa84ad8ec67dfbd9d1d3c4693c25ec7d57d023f62dbcb"),
        ("8", "corrected", "aaab457b54df3e3262ccf418b3086eabcd34ebf11c57c43d47bca75bc5242082"),
    ],
)
def test_a_seeded_run_gives_the_same_bytes_on_every_machine(players, rules, golden):
    options = {"players": players, "rules": rules, **SHORT}
    assert digest(play_at_random(new_game(5, **options), 300, **options)) == golden


def test_a_seeded_run_against_scripts_gives_the_same_bytes_on_every_machine():
    golden = "dc529e9450b73f942dc259d6f94ac5f0972af3f9b9475b3722934b2350b9f13e"
    assert digest(play_beside_scripts(new_game(5, **SHORT), 300)) == golden


def digest_of_a_short_run() -> str:
    beside, alone = play_beside_scripts(new_game(2, **SHORT), 100), play_at_random(new_game(2, **SHORT), 60)
    return digest(beside) + digest(alone)


def test_drawing_shows_the_state_and_leaves_it_alone():
    game = new_game(2, players="8")
    throw(game.arenas[1], 0, 3, game.rules)
    game.arenas[1].players[5].alive, game.arenas[1].players[6].out = False, True
    before, state = game.draw(1), game.arenas.tobytes()
    assert before.shape == (480, 720, 3) and before.dtype == np.uint8
    assert (game.draw(1) == before).all() and game.arenas.tobytes() == state
    game.arenas[1].ball.y += 3.0
    assert (game.draw(1) != before).any()
