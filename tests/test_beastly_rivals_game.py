"""Beastly Rivals Onslaught as the service runs it: clock and ends, sensors, snapshots, determinism, pictures."""

import hashlib
import math

import numpy as np
import pytest

from joybridge.contract.codec import ActArrays
from joybridge.contract.spec import check_spec
from joybridge.games.beastly_rivals import rules as r
from joybridge.games.beastly_rivals.game import BeastlyRivals
from joybridge.games.level_sets import LEVELS_OPTION
from joybridge.games.locomotion import LOCOMOTIONS
from joybridge.games.sight import SIGHT_OPTIONS

OPTIONS = {"rules": "original", "locomotion": "unit_circle", "slow_character": "on", "clock": "together"}
OPTIONS |= {option.name: option.default_choice for option in [LEVELS_OPTION, *SIGHT_OPTIONS]}
NEAR = 1e-12


def new_game(arenas=3, first_arena=0, seed=5, parameters=None, **options):
    return BeastlyRivals({**OPTIONS, **options}, parameters or {}, arenas, first_arena, seed)


def action(lanes, axes=(0.0, 0.0), buttons=(0, 0)):
    return ActArrays(np.tile(np.float32(axes), (lanes, 1)), np.tile(np.int32(buttons), (lanes, 1)))


def random_action(behavior, lanes, random):
    axes = [random.uniform(a.low, a.high, lanes) for a in behavior.device.axes]
    choices = [random.integers(len(b.choices), size=lanes) for b in behavior.device.branches]
    return ActArrays(np.stack(axes, 1).astype(np.float32), np.stack(choices, 1).astype(np.int32))


def test_full_speed_moves_the_cursor_by_2_4_per_decision():
    game = new_game(1)
    game.arenas.cursor.x = game.arenas.cursor.z = 0.0
    game.step([action(1, (0.5, -1.0))])  # 45 degrees, backwards
    assert game.arenas[0].cursor.x == pytest.approx(-2.4 * math.sqrt(0.5), abs=1e-6)
    assert game.arenas[0].cursor.z == pytest.approx(-2.4 * math.sqrt(0.5), abs=1e-6)


def test_the_clock_truncates_all_arenas_after_2000_decisions():
    game = new_game(3, parameters={"beast_speed": 0.0})
    game.arenas.character.x = 5.0
    for decision in range(1, 2001):
        (step,) = game.step([action(3)])
        assert not step.terminated.any() and step.truncated.all() == (decision == 2000), decision
    assert step.ended.tolist() == [0, 1, 2] and step.metrics[:, 0].tolist() == [2000.0] * 3
    assert not (game.arenas.clock.any() or game.arenas.tick.any())


def test_spread_clocks_begin_at_all_phases_and_end_their_episodes_one_by_one():
    game = new_game(16, parameters={"beast_speed": 0.0}, clock="spread")
    begun = game.arenas.clock.copy()
    assert np.diff(np.sort(begun)).max() < 2 * r.CLOCK_TICKS / 16 and (begun % r.DECISION_TICKS == 0).all()
    ahead = int(np.argmax(begun))
    game.arenas.character.x = 5.0
    for _ in range((r.CLOCK_TICKS - begun[ahead]) // r.DECISION_TICKS):
        (step,) = game.step([action(16)])
    assert np.flatnonzero(step.truncated).tolist() == [ahead] and not step.terminated.any()
    assert game.arenas.clock[ahead] == 0 and np.count_nonzero(game.arenas.tick) == 15


def test_the_beginning_of_a_spread_clock_depends_on_the_number_of_the_arena_alone():
    game = new_game(5, clock="spread")
    assert new_game(2, first_arena=3, clock="spread").arenas.clock.tolist() == game.arenas.clock[3:].tolist()
    begun = game.arenas.clock.tolist()
    game.step([action(5)])
    game.reset(None, {})
    assert game.arenas.clock.tolist() == begun


def test_a_death_restarts_its_arena_alone_inside_the_running_clock():
    game = new_game(3)
    game.step([action(3)])
    game.arenas[1].beast.x, game.arenas[1].beast.z = game.arenas[1].character.x, game.arenas[1].character.z
    (step,) = game.step([action(3)])
    assert step.terminated.tolist() == [False, True, False] and not step.truncated.any()
    assert step.rewards[:, r.DEATH].tolist() == [0.0, -1.0, 0.0]
    assert game.arenas.tick.tolist() == [12, 0, 12] and game.arenas.clock.tolist() == [12] * 3
    assert step.final_observations[3][0, :2] == pytest.approx([0, 0], abs=0.01)  # beast at character
    assert step.observations[3][1, 2:4].tolist() == [0.0, 0.0]  # beast at the centre again


def test_a_death_in_the_clocks_last_decision_is_terminated_and_not_truncated():
    game = new_game(3)
    game.arenas.clock = r.CLOCK_TICKS - 6
    game.arenas[2].beast.x, game.arenas[2].beast.z = game.arenas[2].character.x, game.arenas[2].character.z
    (step,) = game.step([action(3)])
    assert step.terminated.tolist() == [False, False, True] and step.truncated.tolist() == [True, True, False]
    assert not game.arenas.clock.any()


def test_metrics_count_decisions_blinks_clicks_and_the_share_of_slow_ticks():
    game = new_game(1, parameters={"beast_speed": 0.0})
    for body, x in (("character", 5.0), ("cursor", 5.0), ("sphere", 5.0)):
        game.arenas[body].x, game.arenas[body].z = x, 0.0
    for buttons in ((0, 1), (1, 0), (0, 0)):
        game.step([action(1, buttons=buttons)])
    game.arenas.clock = r.CLOCK_TICKS - 6
    (step,) = game.step([action(1, buttons=(1, 1))])
    (behavior,) = BeastlyRivals.describe(OPTIONS).behaviors
    assert [metric.name for metric in behavior.metrics] == ["survival", "blinks", "clicks", "slow_share"]
    assert step.metrics[0].tolist() == pytest.approx([4, 1, 3, 23 / 24])  # the first tick notices the sphere


def test_observation_has_its_22_values_in_order_and_units():
    game = new_game(1)
    arena = game.arenas[0]
    for body, values in {
        "cursor": (3.5, -7, 10, -5),
        "character": (1.4, 2.1, 4, -1),
        "beast": (-5, 2, 1.7, 3.4),
        "sphere": (0, 0.7, 0.3, -0.6),
    }.items():
        arena[body].x, arena[body].z, arena[body].vx, arena[body].vz = values
    arena.cooldown, arena.speed, arena.accuracy = 50, 4.25, 0.15
    observed = np.concatenate([sensor[0] for sensor in game.observe()[0].observations])
    assert observed == pytest.approx(
        np.concatenate(
            [
                [0.25, 0],  # blink
                [0.5, -1, 0.5, -0.25],  # cursor
                [0.2, 0.3, 1, -0.25],  # character
                [0.64, 0.01, -0.5, 0.2, 0.2, 0.4, 0.5, 0.2],  # beast
                [0.2, 0.2, 0.4, -0.8],  # slow sphere
            ]
        )
    )
    arena.cooldown = 0
    assert game.observe()[0].observations[0][0].tolist() == [0.0, 1.0]


@pytest.mark.parametrize("locomotion", LOCOMOTIONS)
def test_spec_is_well_formed_and_observations_keep_to_its_bounds(locomotion):
    options = {**OPTIONS, "locomotion": locomotion}
    spec = BeastlyRivals.describe(options)
    check_spec(spec)
    (behavior,) = spec.behaviors
    assert (spec.decision_interval, spec.tick_seconds, spec.max_episode_decisions) == (6, 0.02, 2000)
    assert [branch.name for branch in behavior.device.branches][-2:] == ["move", "blink"]
    assert [channel.name for channel in behavior.channels] == ["survival", "death", "early_blink"]
    assert (behavior.sensors[-1].name == "heading") == (locomotion == "steer")
    game, random = new_game(16, locomotion=locomotion, parameters={"beast_speed": 1.5}), np.random.default_rng(0)
    for _ in range(300):
        (step,) = game.step([random_action(behavior, 16, random)])
        for sensor, values in zip(behavior.sensors, step.observations, strict=True):
            assert values.shape == (16, *sensor.shape) and values.dtype == np.float32
            assert (values >= np.array(sensor.low, np.float32)).all() and (
                values <= np.array(sensor.high, np.float32)
            ).all(), sensor.name


def test_beast_speed_scales_start_growth_and_limit():
    game = new_game(1, parameters={"beast_speed": 0.5})
    assert game.arenas[0].speed == 0.4
    game.step([action(1)])
    assert game.arenas[0].speed == pytest.approx(0.403, abs=NEAR)
    game.arenas.speed = 4.2499
    game.step([action(1)])
    assert game.arenas[0].speed == 4.25
    game.reset(None, {"beast_speed": 1.0})
    assert game.arenas[0].speed == 0.8


def play(game, decisions, seed=3):
    """Return the bytes of observations, rewards and ends of a random run of five arenas."""
    (behavior,) = BeastlyRivals.describe(OPTIONS).behaviors
    random, content = np.random.default_rng(seed), []
    for _ in range(decisions):
        (step,) = game.step([random_action(behavior, 5, random)])
        content += [*step.observations, step.rewards, step.terminated]
    return b"".join(array.tobytes() for array in content)


def test_an_arena_plays_the_same_game_alone_as_among_others():
    among = new_game(5)
    (behavior,) = BeastlyRivals.describe(OPTIONS).behaviors
    random = np.random.default_rng(3)
    alone = [new_game(1, first_arena=i) for i in range(5)]
    for _ in range(300):
        act = random_action(behavior, 5, random)
        (all_five,) = among.step([act])
        for i, game in enumerate(alone):
            (one,) = game.step([ActArrays(act.axes[i : i + 1], act.choices[i : i + 1])])
            for a, b in zip([*all_five.observations, all_five.rewards], [*one.observations, one.rewards], strict=True):
                assert a[i : i + 1].tobytes() == b.tobytes()


def test_a_restored_game_continues_to_the_same_bytes():
    game = new_game(5, parameters={"beast_speed": 1.2})
    play(game, 100)
    state = {name: array.copy() for name, array in game.save().items()}
    wanted = play(game, 200, seed=4)
    other = new_game(5, seed=99)
    other.restore(state)
    assert play(other, 200, seed=4) == wanted


@pytest.mark.parametrize(("field", "value"), [("cooldown", 201), ("clock", -1), ("speed", math.nan), ("heading", 1e9)])
def test_restore_refuses_a_state_that_no_game_can_be_in(field, value):
    game = new_game(2)
    arenas = game.arenas.copy()
    arenas[field][1] = value
    state = {**game.save(), "arenas": np.frombuffer(arenas.tobytes(), np.uint8).reshape(2, -1)}
    with pytest.raises(ValueError, match=field):
        game.restore(state)


def test_reset_begins_new_episodes_and_with_a_seed_the_game_of_that_seed():
    game = new_game(5)
    first = play(game, 20)
    game.reset(None, {})
    assert not (game.arenas.tick.any() or game.arenas.clock.any())
    assert play(game, 20) != first
    game.reset(5, {})
    assert play(game, 20) == first


@pytest.mark.parametrize(
    ("rules", "golden"),
    [
        ("original", "8523f1ffcf150ed28c9e29d28a96fbe72fb0ae3ed8246e1592d8aeb260a33184"),
        ("corrected", "32a5e26d0fbdd88f938682ee5ef2d7587eb735d39f17958d7e4528773a6d8170"),
    ],
)
def test_a_seeded_run_gives_the_same_bytes_on_every_machine(rules, golden):
    assert hashlib.sha256(play(new_game(5, rules=rules), 300)).hexdigest() == golden


def digest_of_a_short_run() -> str:
    return hashlib.sha256(play(new_game(5, rules="corrected"), 100)).hexdigest()


def test_drawing_shows_the_state_and_leaves_it_alone():
    game = new_game(2)
    before, state = game.draw(1), game.arenas.tobytes()
    assert before.shape == (480, 640, 3) and before.dtype == np.uint8
    assert (game.draw(1) == before).all() and game.arenas.tobytes() == state
    game.arenas[1].beast.x += 1.0
    assert (game.draw(1) != before).any()
