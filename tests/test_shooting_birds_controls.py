"""What an agent of Shooting Birds senses, and what its axes and branches do."""

import math

import numpy as np
import pytest

from joybridge.contract.codec import ActArrays
from joybridge.games.locomotion import LOCOMOTIONS
from joybridge.games.shooting_birds.game import ShootingBirds
from tests.support.shooting_birds import (
    DEFAULTS,
    DRY_SHOT,
    HIT,
    MISS,
    NEAR,
    STILL,
    action,
    moves,
    neutral,
    new_game,
    sense,
)

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
