"""Shooting Birds as the service runs it: spec, sensors, steering, episodes, determinism, snapshots, pictures."""

import hashlib
import math
from itertools import product
from typing import Any

import numpy as np
import pytest

from joybridge.contract.codec import ActArrays, Codec
from joybridge.contract.spec import check_spec
from joybridge.contract.tensors import Array
from joybridge.games.locomotion import LOCOMOTIONS
from joybridge.games.shooting_birds import camera
from joybridge.games.shooting_birds.game import CHANNELS, OPTIONS, ShootingBirds
from joybridge.games.sight import SIGHT_OPTIONS
from joybridge.simulator.randomness import BLOCK
from tests.support.measured import interpreted
from tests.support.wire import pack_step

HIT, MISS, DRY_SHOT, RELOAD, AIMED_HIT, AIMED_MISS = range(6)
DEFAULTS = {
    "rules": "original",
    "locomotion": "unit_circle",
    "level": "random",
    "levels": "original",
    "birds": "straight",
} | {option.name: option.default_choice for option in [*camera.OPTIONS, *SIGHT_OPTIONS]}
WEIGHTS = np.array([1, 1, 1, 1, 0, 0])
NEAR = 1e-6  # of float32
STILL = (0.0, 0.0)


def new_game(
    arenas: int = 1, first_arena: int = 0, seed: int = 5, parameters: dict[str, float] | None = None, **options: str
) -> ShootingBirds:
    return ShootingBirds({**DEFAULTS, **options}, parameters or {}, arenas, first_arena, seed)


def action(lanes: int, axes: tuple[float, ...] = STILL, choices: tuple[int, ...] = (0, 0)) -> ActArrays:
    """Return the same action for every lane."""
    return ActArrays(np.tile(np.array(axes, np.float32), (lanes, 1)), np.tile(np.array(choices, np.int32), (lanes, 1)))


def sense(game: ShootingBirds) -> list[Array]:
    """Return the observations of the first arena, one array per sensor."""
    return [values[0] for values in game.observe()[0].observations]


def moves(rays: Array, numbers: Array, k: int) -> Array:
    """Return axes for decision k: now and then a wild sweep, else straight to the nearest bird that the rays meet.

    They depend on the arenas' numbers in the seed and on what they observe, on nothing else.
    """
    distances = np.where(rays[:, :, 0] < 0, np.float32(2), rays[:, :, 0])
    ray, distance = distances.argmin(axis=1), distances.min(axis=1)
    backwards = (ray > 3) & (ray < 9)
    angle = np.where(backwards, ray - 6, np.where(ray < 9, ray, ray - 12)).astype(np.float32) / np.float32(3)
    speed = np.minimum(distance * np.float32(14), np.float32(1)) * np.where(backwards, np.float32(-1), np.float32(1))
    sweep_angle = ((37 * k + 11 * numbers) % 41 - 20).astype(np.float32) / np.float32(20)
    sweep_speed = ((13 * (k // 8) + 5 * numbers) % 41 - 20).astype(np.float32) / np.float32(20)
    sweep = (distance > 1) | ((k // 16 + numbers) % 4 == 0)
    return np.stack([np.where(sweep, sweep_angle, angle), np.where(sweep, sweep_speed, speed)], axis=1)


def play(game: ShootingBirds, steps: int, begin: int = 0) -> Array:
    """Hunt and return all observations and rewards [arenas, steps, values]."""
    numbers = game.first_arena + np.arange(len(game.arenas))
    (step,), rows = game.observe(), []
    for k in range(begin, begin + steps):
        gun, _, rays, hovered = step.observations
        shoot, reload = (hovered[:, 0] == 1) | (k % 8 == 0), (gun[:, 0] == 0) & (k % 16 == 3) | (k % 128 == 0)
        act = ActArrays(moves(rays, numbers, k), np.stack([shoot, reload], axis=1).astype(np.int32))
        (step,) = game.step([act])
        rows.append([*(values.reshape(len(numbers), -1) for values in step.observations), step.rewards])
    return np.stack([np.concatenate(row, axis=1) for row in rows], axis=1)


def saved(game: ShootingBirds) -> dict[str, Array]:
    return {name: values.copy() for name, values in game.save().items()}


# --------------------------------------------------------------------------------------------------- spec


@pytest.mark.parametrize("locomotion", LOCOMOTIONS)
def test_every_choice_of_options_has_a_well_formed_spec_that_its_game_keeps(locomotion):
    by_name = {option.name: option for option in OPTIONS}
    assert list(by_name) == list(DEFAULTS) and {n: o.default_choice for n, o in by_name.items()} == DEFAULTS
    for rules, level in product(by_name["rules"].choices, by_name["level"].choices):
        options = {**DEFAULTS, "rules": rules, "locomotion": locomotion, "level": level}
        spec = ShootingBirds.describe(options)
        check_spec(spec)
        (behavior,) = spec.behaviors
        game = new_game(3, **options)
        for values in (game.observe(), game.step([action(3, *neutral(behavior))])):
            for sensor, observed in zip(behavior.sensors, values[0].observations, strict=True):
                assert observed.shape == (3, *sensor.shape) and observed.dtype == np.float32
            assert values[0].rewards.shape == (3, len(behavior.channels)) and values[0].rewards.dtype == np.float32
            Codec(behavior, 3).unpack_step(pack_step(values[0]))


def neutral(behavior: Any) -> tuple[tuple[float, ...], tuple[int, ...]]:
    return (0.0,) * len(behavior.device.axes), (0,) * len(behavior.device.branches)


def test_one_decision_is_one_tick_of_0_02_s_and_an_episode_2000_of_them():
    spec = ShootingBirds.describe(DEFAULTS)
    assert (spec.decision_interval, spec.tick_seconds, spec.max_episode_decisions) == (1, 0.02, 2000)


def test_the_original_observes_44_values_with_an_agent_of_2_axes_and_2_buttons():
    (behavior,) = ShootingBirds.describe(DEFAULTS).behaviors
    assert [list(sensor.shape) for sensor in behavior.sensors] == [[2], [5], [12, 3], [1]]
    assert sum(math.prod(sensor.shape) for sensor in behavior.sensors) == 44
    assert [axis.name for axis in behavior.device.axes] == ["angle", "speed"]
    assert [branch.name for branch in behavior.device.branches] == ["shoot", "reload"]
    assert behavior.agents_per_arena == 1


def test_the_reward_is_the_sum_of_hits_misses_dry_shots_and_reloads():
    assert [(channel.name, channel.default_weight) for channel in CHANNELS] == list(
        zip(("hit", "miss", "dry_shot", "reload", "aimed_hit", "aimed_miss"), WEIGHTS, strict=True)
    )


def test_observations_keep_to_their_bounds():
    (behavior,) = ShootingBirds.describe(DEFAULTS).behaviors
    values, begin = play(new_game(16), 400), 0
    for sensor in behavior.sensors:
        part = values[:, :, begin : begin + math.prod(sensor.shape)]
        assert part.min() >= sensor.low[0] and part.max() <= sensor.high[0], sensor.name
        begin += part.shape[2]


# ------------------------------------------------------------------------------------------------ sensors


@pytest.mark.parametrize(("x", "seen"), [(-17.715, -16.615 / 17.715), (-1.1, 0.0), (17.715, 18.815 / 17.715)])
def test_the_original_counts_x_from_minus_1_1_in_units_of_17_715(x, seen):
    game = new_game()
    game.arenas.x = x
    assert sense(game)[1][0] == pytest.approx(seen, abs=NEAR)


@pytest.mark.parametrize(("x", "seen"), [(-17.715, -1.0), (0.0, 0.0), (8.8575, 0.5)])
def test_the_corrected_game_counts_x_from_the_centre(x, seen):
    game = new_game(rules="corrected")
    game.arenas.x = x
    assert sense(game)[1][0] == pytest.approx(seen, abs=NEAR)


@pytest.mark.parametrize("rules", ["original", "corrected"])
def test_y_counts_from_the_centre_in_units_of_10_215(rules):
    game = new_game(rules=rules)
    for y, seen in ((-10.215, -1.0), (0.0, 0.0), (5.1075, 0.5)):
        game.arenas.y = y
        assert sense(game)[1][1] == pytest.approx(seen, abs=NEAR)


@pytest.mark.parametrize(
    ("velocity", "seen"),
    [
        ((30.0, -40.0), [0.6, -0.8, 1.0]),
        ((0.0, 25.0), [0.0, 1.0, 0.5]),
        ((0.0, 0.0), [0.0, 0.0, 0.0]),
        ((0.0, 1.01e-5), [0.0, 1.0, 2.02e-7]),
        ((0.0, 0.99e-5), [0.0, 0.0, 1.98e-7]),  # too slow to have a direction
    ],
)
def test_the_velocity_is_observed_as_a_direction_and_a_share_of_50(velocity, seen):
    game = new_game()
    game.arenas.vx, game.arenas.vy = velocity
    assert sense(game)[1][2:] == pytest.approx(seen, abs=1e-10, rel=1e-6)


def test_the_observed_velocity_has_lost_its_part_into_a_wall():
    game = new_game()
    game.arenas.x, game.arenas.y = 17.715, 0.0
    (step,) = game.step([action(1, (2 / math.pi * math.atan2(4, 3), 1.0))])  # 30 to the right, 40 up
    assert step.observations[1][0, 2:] == pytest.approx([0.0, 1.0, 28 / 50], abs=1e-5)


@pytest.mark.parametrize("ammo", range(9))
def test_the_ammo_sensor_is_1_only_at_a_full_magazine_in_the_original_and_a_ratio_in_the_corrected_game(ammo):
    for rules, seen in (("original", float(ammo == 8)), ("corrected", ammo / 8)):
        game = new_game(rules=rules)
        game.arenas.ammo = ammo
        assert sense(game)[0].tolist() == [float(ammo > 0), seen]


def test_hovered_is_1_at_a_bird_minus_1_at_an_obstacle_and_0_at_nothing():
    game = new_game(level="0")
    game.arenas.birds.x, game.arenas.birds.y = -15.0, 9.0
    game.arenas.birds.kind, game.arenas.birds.z = 1, 0.85
    for place, seen in (((-15.0, 9.0), 1.0), ((5.0, 0.0), -1.0), ((-10.27, 2.0), -1.0), ((-2.0, 9.0), 0.0)):
        game.arenas.x, game.arenas.y = place
        assert sense(game)[3].tolist() == [seen]
    game.arenas.birds.x, game.arenas.birds.y = -10.27, 2.0
    game.arenas.x, game.arenas.y = -10.27, 2.0
    assert sense(game)[3].tolist() == [1.0]  # before the tree
    game.arenas.birds.kind, game.arenas.birds.z = 2, 1.85
    assert sense(game)[3].tolist() == [-1.0]  # behind it


def test_rays_are_observed_as_shares_of_14():
    game = new_game(level="5")
    game.arenas.birds.y, game.arenas.x, game.arenas.y = 1000.0, 13.0, 2.0
    rays = sense(game)[2]
    assert rays.shape == (12, 3) and (rays[:, :2] == -1.0).all()
    assert rays[6, 2] == pytest.approx((13.0 - 11.505) / 14, abs=NEAR) and rays[0, 2] == -1.0


def test_what_is_hovered_decides_whether_the_next_shot_hits():
    game, numbers, hovering = new_game(32), np.arange(32), 0
    (step,), press = game.observe(), np.tile(np.array([1, 0], np.int32), (32, 1))
    for k in range(200):
        game.arenas.ammo = 8
        rays, birds = step.observations[2], step.observations[3][:, 0] == 1
        (step,) = game.step([ActArrays(moves(rays, numbers, k), press)])
        assert ((step.rewards[:, HIT] > 0) == birds).all() and ((step.rewards[:, MISS] < 0) != birds).all()
        hovering += birds.sum()
    assert hovering > 100


# ----------------------------------------------------------------------------------------------- steering


@pytest.mark.parametrize(
    ("axes", "velocity"),
    [
        ((0.0, 1.0), (50, 0)),
        ((0.0, -1.0), (-50, 0)),
        ((1.0, 1.0), (0, 50)),
        ((-1.0, 1.0), (0, -50)),
        ((0.5, 1.0), (50 * math.sqrt(0.5), 50 * math.sqrt(0.5))),
        ((-0.5, -0.4), (-20 * math.sqrt(0.5), 20 * math.sqrt(0.5))),
        ((0.7, 0.0), (0, 0)),
    ],
)
def test_on_the_unit_circle_the_angle_is_a_share_of_90_degrees_and_the_speed_a_signed_share_of_50(axes, velocity):
    game = new_game()
    game.arenas.x = game.arenas.y = 0.0
    game.step([action(1, axes)])
    assert (game.arenas[0].vx, game.arenas[0].vy) == pytest.approx(velocity, abs=1e-5)
    assert (game.arenas[0].x, game.arenas[0].y) == pytest.approx(np.multiply(0.02, velocity), abs=NEAR)


def test_at_full_speed_the_crosshair_moves_1_unit_per_tick():
    game = new_game()
    game.arenas.x = game.arenas.y = 0.0
    for k in range(1, 6):
        game.step([action(1, (0.0, -1.0))])
        assert game.arenas[0].x == pytest.approx(-k, abs=1e-9)


@pytest.mark.parametrize(("axes", "velocity"), [((1.0, 0.0), (50, 0)), ((-0.5, 1.0), (-25, 50)), (STILL, (0, 0))])
def test_axes_command_both_parts_of_the_velocity(axes, velocity):
    game = new_game(locomotion="axes")
    game.arenas.x = game.arenas.y = 0.0
    game.step([action(1, axes)])
    assert (game.arenas[0].vx, game.arenas[0].vy) == pytest.approx(velocity, abs=1e-9)


def test_steer_turns_a_heading_by_at_most_30_degrees_per_decision_and_moves_along_it():
    game = new_game(locomotion="steer")
    for turn, speed, heading in ((1.0, 1.0, 30), (0.5, 0.5, 45), (0.0, -1.0, 45), (-1.0, 0.0, 15)):
        game.arenas.x = game.arenas.y = 0.0
        game.step([action(1, (turn, speed))])
        direction = np.array([math.cos(math.radians(heading)), math.sin(math.radians(heading))])
        assert (game.arenas[0].vx, game.arenas[0].vy) == pytest.approx(50 * speed * direction, abs=1e-9)
        assert sense(game)[4] == pytest.approx(direction, abs=NEAR)


def test_a_heading_goes_round_and_stays_within_half_a_turn():
    game = new_game(locomotion="steer")
    for k in range(1, 30):
        game.step([action(1, (1.0, 0.0))])
        assert abs(game.arenas[0].heading) <= math.pi + 1e-9
        assert sense(game)[4] == pytest.approx([math.cos(k * math.pi / 6), math.sin(k * math.pi / 6)], abs=NEAR)


@pytest.mark.parametrize(
    ("cell", "speed", "velocity"),
    [
        ("+2,+2", 1.0, (50, 50)),
        ("-2,+0", 1.0, (-50, 0)),
        ("+1,-1", 1.0, (25, -25)),
        ("+0,-2", 0.5, (0, -25)),
        ("+0,+0", 1.0, (0, 0)),
    ],
)
def test_a_grid_cell_commands_a_velocity_towards_it(cell, speed, velocity):
    game = new_game(locomotion="grid")
    device = ShootingBirds.describe({**DEFAULTS, "locomotion": "grid"}).behaviors[0].device
    assert len(device.branches[0].choices) == 25 and (device.axes[0].low, device.axes[0].high) == (0.0, 1.0)
    game.arenas.x = game.arenas.y = 0.0
    game.step([action(1, (speed,), (list(device.branches[0].choices).index(cell), 0, 0))])
    assert (game.arenas[0].vx, game.arenas[0].vy) == pytest.approx(velocity, abs=1e-9)


@pytest.mark.parametrize("locomotion", LOCOMOTIONS)
def test_the_last_two_branches_are_shoot_and_reload(locomotion):
    game = new_game(locomotion=locomotion)
    axes, choices = neutral(ShootingBirds.describe({**DEFAULTS, "locomotion": locomotion}).behaviors[0])
    game.arenas.ammo = 0
    (step,) = game.step([action(1, axes, (*choices[:-2], 1, 0))])
    assert step.rewards[0, DRY_SHOT] == -1.0 and game.arenas[0].ammo == 0
    game.step([action(1, axes, (*choices[:-2], 0, 1))])
    assert game.arenas[0].ammo == 8


# ----------------------------------------------------------------------------------------------- episodes


def test_all_arenas_are_truncated_together_after_every_2000_decisions_and_never_terminated():
    game, cut = new_game(3), []
    (behavior,) = ShootingBirds.describe(DEFAULTS).behaviors
    for decision in range(1, 4001):
        (step,) = game.step([action(3, (0.3, 0.05), (decision % 90 == 0, decision % 700 == 0))])
        assert not step.terminated.any() and step.truncated.all() == step.truncated.any()
        if step.truncated.any():
            cut.append(decision)
            assert step.ended.tolist() == [0, 1, 2]
            Codec(behavior, 3).unpack_step(pack_step(step))
        else:
            assert len(step.ended) == 0 and step.final_observations is None and step.metrics is None
    assert cut == [2000, 4000]


def last_step(game: ShootingBirds, axes: tuple[float, ...] = STILL) -> Any:
    """Return the step that ends the present episode."""
    game.arenas.tick = 1999
    (step,) = game.step([action(len(game.arenas), axes)])
    assert step.truncated.all()
    return step


def test_the_last_step_brings_the_end_of_one_episode_and_the_beginning_of_the_next():
    game, other = new_game(3), new_game(3)
    step = last_step(game, (0.1, 0.2))
    (unbroken,) = other.step([action(3, (0.1, 0.2))])
    for final, wanted in zip(step.final_observations, unbroken.observations, strict=True):
        assert final.tobytes() == wanted.tobytes()
    for first, wanted in zip(step.observations, game.observe()[0].observations, strict=True):
        assert first.tobytes() == wanted.tobytes()
    assert (step.observations[1][:, :2] != step.final_observations[1][:, :2]).all()
    assert not (game.arenas.tick.any() or game.arenas.shots.any())


def test_a_new_episode_keeps_birds_and_their_clock_and_is_seen_with_the_old_velocity():
    game, other = new_game(3), new_game(3)
    step = last_step(game, (0.1, 0.2))
    other.step([action(3, (0.1, 0.2))])
    assert game.arenas.birds.tobytes() == other.arenas.birds.tobytes()
    assert game.arenas.clock.tolist() == [1, 1, 1]
    assert (step.observations[1][:, 2:] == step.final_observations[1][:, 2:]).all()
    assert step.observations[1][:, 4] == pytest.approx([0.2] * 3, abs=NEAR)


def test_metrics_are_accuracy_shots_hits_and_reloads_of_the_episode():
    (behavior,) = ShootingBirds.describe(DEFAULTS).behaviors
    assert [metric.name for metric in behavior.metrics] == ["click_accuracy", "shots", "hits", "reloads"]
    game = new_game(2)
    game.arenas.shots, game.arenas.hits, game.arenas.reloads = [8, 0], [2, 0], [3, 1]
    assert last_step(game).metrics.tolist() == [[0.25, 8, 2, 3], [0, 0, 0, 1]]
    assert last_step(game).metrics.tolist() == [[0, 0, 0, 0]] * 2


def test_a_level_option_fixes_the_level_of_every_episode_and_random_does_not():
    game = new_game(64, level="3")
    for begin in (lambda: None, lambda: last_step(game), lambda: game.reset(None, {}), lambda: game.reset(8, {})):
        begin()
        assert (game.arenas.level == 3).all()
    assert set(new_game(64).arenas.level) == set(range(7))


def test_bird_speed_is_a_factor_on_the_speed_of_birds_to_come():
    slow, fast = new_game(64), new_game(64, parameters={"bird_speed": 3.0})
    assert (fast.arenas.birds.vx == 3 * slow.arenas.birds.vx).all()
    before = fast.arenas.birds.vx.copy()
    fast.reset(None, {"bird_speed": 0.5})
    assert (fast.arenas.birds.vx == before).all()
    fast.arenas.birds.x = 21.0
    fast.step([action(64)])
    speeds = abs(fast.arenas.birds.vx)
    assert 0.75 <= speeds.min() < 0.8 and 2.9 < speeds.max() <= 3.0


def test_reset_begins_new_episodes_among_the_same_birds():
    game = new_game(5)
    play(game, 20)
    birds, place = game.arenas.birds.tobytes(), game.arenas.x.copy()
    game.reset(None, {})
    assert game.arenas.birds.tobytes() == birds and (game.arenas.x != place).all()
    assert not game.arenas.tick.any() and game.arenas.clock.tolist() == [20] * 5


# -------------------------------------------------------------------------------------------- determinism


def test_an_arena_plays_the_same_bytes_alone_as_among_3_or_64():
    three, many = play(new_game(3), 250), play(new_game(64), 250)
    for arena in (0, 1, 2):
        alone = play(new_game(1, first_arena=arena), 250)[0].tobytes()
        assert three[arena].tobytes() == alone and many[arena].tobytes() == alone
    for first in (20, 63):
        assert play(new_game(1, first_arena=first), 250)[0].tobytes() == many[first].tobytes()


def test_the_same_seed_gives_the_same_bytes_and_another_seed_or_arena_others():
    first = play(new_game(3), 100)
    assert play(new_game(3), 100).tobytes() == first.tobytes()
    assert play(new_game(3, seed=6), 100).tobytes() != first.tobytes()
    assert len({arena.tobytes() for arena in first}) == 3


def test_reset_with_a_seed_gives_the_bytes_of_a_new_game_with_that_seed():
    game = new_game(3, seed=1, first_arena=4, locomotion="unit_circle", level="2")
    play(game, 150)
    game.reset(9, {})
    assert play(game, 150).tobytes() == play(new_game(3, seed=9, first_arena=4, level="2"), 150).tobytes()


@pytest.mark.parametrize("rules", ["original", "corrected"])
def test_a_restored_game_continues_to_the_same_bytes(rules):
    game = new_game(5, rules=rules, parameters={"bird_speed": 1.5})
    game.arenas.tick = 1900
    play(game, 60)
    state = saved(game)
    wanted = play(game, 200, begin=60)  # into the next episode
    other = new_game(5, rules=rules, seed=99)
    other.restore(state)
    assert play(other, 200, begin=60).tobytes() == wanted.tobytes()


def test_a_snapshot_takes_no_more_bytes_than_the_spec_says():
    size = sum(values.nbytes for values in new_game(10).save().values())
    assert size <= 10 * ShootingBirds.describe(DEFAULTS).snapshot_bytes_per_arena


@pytest.mark.parametrize(
    ("field", "value"),
    [
        *(("level", level) for level in (-1, 7, 9)),
        *(("fixed_level", level) for level in (-2, 7)),
        *(("ammo", ammo) for ammo in (-1, 9)),
        *(("tick", tick) for tick in (-1, 2001)),
        *product(("x", "y", "vx", "vy", "heading"), (math.nan, -math.inf)),
        *(("bird_speed", speed) for speed in (-0.1, 4.1, math.nan)),
    ],
)
def test_restore_refuses_a_crosshair_gun_episode_or_parameter_that_cannot_be(field, value):
    game = new_game(2)
    arenas = game.arenas.copy()
    arenas[field][1] = value
    refuses(game, "outside", arenas=np.frombuffer(arenas.tobytes(), np.uint8).reshape(2, -1))


@pytest.mark.parametrize(
    ("field", "value"),
    [("kind", -1), ("kind", 3), ("kind", 7), *product(("x", "y", "z", "vx", "vy", "phase"), (math.nan, math.inf))],
)
def test_restore_refuses_a_bird_that_cannot_be(field, value):
    game = new_game(2)
    arenas = game.arenas.copy()
    arenas.birds[field][1, 7] = value
    refuses(game, "outside", arenas=np.frombuffer(arenas.tobytes(), np.uint8).reshape(2, -1))


@pytest.mark.parametrize(
    ("part", "value"),
    [
        ("cursor", -1),
        ("cursor", BLOCK + 1),
        ("block", -1),
        ("episodes", 0),
    ],
)
def test_restore_refuses_random_streams_and_numbers_of_episodes_that_cannot_be(part, value):
    game = new_game(2)
    values = game.save()[part].copy()
    values[-1] = value
    refuses(game, "outside", **{part: values})


def test_restore_refuses_arenas_in_different_ticks_of_their_episodes():
    game = new_game(2)
    arenas = game.arenas.copy()
    arenas.tick[1] = 1999
    refuses(game, "tick", arenas=np.frombuffer(arenas.tobytes(), np.uint8).reshape(2, -1))


def refuses(game: ShootingBirds, because: str, **parts: Array) -> None:
    """Check that a game refuses its own state with some parts changed, and plays on as if nothing had been."""
    play(game, 5)
    state = saved(game)
    with pytest.raises(ValueError, match=because):
        game.restore({**state, **parts})
    now = saved(game)
    assert all(now[name].tobytes() == state[name].tobytes() for name in state)


GOLDEN = {
    "original": "0cb994be5e85c09c5727b31c4989452fb2c3882cc6ff5d70323f83b8d3b322ec",
    "corrected": "3e65ce1a6bedaee65a8babf577d93ef560b57272032504582657df95712a4a38",
}


@pytest.mark.parametrize("rules", GOLDEN)
def test_a_seeded_run_gives_the_bytes_it_always_gave(rules):
    game = new_game(5, rules=rules, seed=2024)
    game.arenas.tick = 1800
    values = play(game, 300)
    assert (values[:, :, -6:] != 0).sum(axis=(0, 1)).min() >= 5  # every channel is in play
    assert hashlib.sha256(values.tobytes()).hexdigest() == GOLDEN[rules]


def digest_of_a_short_run() -> str:
    """Return the hash of a run that shoots, reloads, sinks into walls and replaces birds within 30 steps."""
    values = []
    for rules in ("original", "corrected"):
        game = new_game(2, rules=rules)
        arenas: Any = game.arenas
        arenas.x, arenas.y = [17.0, -17.3], [9.0, -9.6]
        arenas.birds.x[:, :4], arenas.birds.y[:, :4] = arenas.x[:, None], arenas.y[:, None]
        arenas.birds.x[:, 4] = 21.0
        values.append(play(game, 30))
        assert values[-1][:, :, -6 + HIT].sum() > 0 and values[-1][:, :, -6 + MISS].sum() < 0
    return hashlib.sha256(np.concatenate(values).tobytes()).hexdigest()


def test_interpreted_rules_give_the_bytes_of_compiled_ones():
    assert interpreted("tests.support.digest", "tests.test_shooting_birds_game").split()[-1] == digest_of_a_short_run()


# -------------------------------------------------------------------------------- baseline and pictures


def test_random_buckets_earn_about_minus_645_and_hit_with_0_75_percent():
    game, random = new_game(63, seed=1), np.random.default_rng(0)
    game.arenas.level = np.arange(63) % 7
    reward = np.zeros(63)
    for _ in range(2000):
        axes = (random.integers(11, size=(63, 2)) / 5 - 1).astype(np.float32)
        button = random.integers(3, size=63)  # shoot, reload or neither
        (step,) = game.step([ActArrays(axes, np.stack([button == 0, button == 1], axis=1).astype(np.int32))])
        reward += step.rewards @ WEIGHTS
    assert reward.mean() == pytest.approx(-645, abs=20)
    assert step.metrics is not None
    assert step.metrics[:, 0].mean() == pytest.approx(0.0075, abs=0.0015)


@pytest.mark.parametrize("level", range(7))
def test_every_level_is_drawn_as_a_picture_of_the_specs_size(level):
    game = new_game(level=str(level))
    size = ShootingBirds.describe(DEFAULTS).picture
    picture = game.draw(0)
    assert picture.shape == (size.height, size.width, 3) and picture.dtype == np.uint8
    other = new_game(level=str((level + 1) % 7))
    other.arenas.birds, other.arenas.x, other.arenas.y = game.arenas.birds, game.arenas.x, game.arenas.y
    assert (other.draw(0) != picture).any(axis=2).mean() > 0.05


@pytest.mark.parametrize("change", ["birds", "crosshair", "ammo"])
@pytest.mark.promise("D4")
def test_a_picture_shows_the_state_of_its_arena_and_leaves_it_alone(change):
    game = new_game(2)
    arenas: Any = game.arenas
    arenas.birds.x[1, 0], arenas.birds.y[1, 0] = -2.0, 9.0
    arenas.birds.kind[1, 0], arenas.birds.z[1, 0] = 0, -0.15
    arenas.x, arenas.y, arenas.ammo = 3.0, -3.0, 5
    before, state = game.draw(1), arenas.tobytes()
    assert (game.draw(1) == before).all() and arenas.tobytes() == state
    if change == "birds":
        arenas.birds.x[1, 0] += 0.5
    elif change == "crosshair":
        arenas.x[1] += 0.5
    else:
        arenas.ammo[1] -= 1
    assert (game.draw(1) != before).any()
