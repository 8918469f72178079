"""What is in front of what in Shooting Birds, and what its rays see."""

import math
from typing import Any

import numpy as np
import pytest

from joybridge.contract.tensors import Array
from joybridge.games.shooting_birds.levels import OBSTACLES, Obstacles
from tests.support.shooting_birds_scene import LARGE, MEDIUM, PLACES, SMALL, Scene, obstacles

NOTHING, OBSTACLE = -1, -2
RADIUS = (1.26, 0.84, 0.42)


def only(ray: int, distance: float) -> Any:
    """Return what the twelve rays measure if a single one of them meets something."""
    expected = np.full(12, -1.0)
    expected[ray] = distance
    return pytest.approx(expected, abs=1e-5)


HIDES = {"barn": (MEDIUM, SMALL), "trunk": (SMALL,), "crown": (SMALL,), "open": ()}


@pytest.mark.parametrize("shift", [0.1, 0.2])
@pytest.mark.parametrize("kind", [LARGE, MEDIUM, SMALL])
@pytest.mark.parametrize("where", PLACES)
def test_barns_hide_medium_and_small_birds_and_trees_hide_small_ones(where, kind, shift):
    scene = Scene(place=PLACES[where], things=OBSTACLES)
    assert scene.front() == (NOTHING if where == "open" else OBSTACLE)
    scene.put(3, kind, z=kind - shift)
    assert scene.front() == (OBSTACLE if kind in HIDES[where] else 3)


def test_where_a_barn_and_a_tree_overlap_the_barns_depth_counts():
    things = Obstacles(
        np.array([[[0.0, 0.0, 2.0, 1.1]]]),
        np.array([1]),
        np.array([[[-1.0, -1.0, 1.0, 1.0, 0.0]]]),
        np.array([1]),
    )
    for kind, seen in ((LARGE, 0), (MEDIUM, OBSTACLE), (SMALL, OBSTACLE)):
        scene = Scene(things=things)
        scene.put(0, kind)
        assert scene.front() == seen


@pytest.mark.parametrize(("nearer", "farther"), [(LARGE, MEDIUM), (LARGE, SMALL), (MEDIUM, SMALL)])
@pytest.mark.parametrize(("first", "second"), [(0, 9), (9, 0)])
def test_a_larger_bird_is_in_front_of_a_smaller_one(nearer, farther, first, second):
    scene = Scene()
    scene.put(first, nearer, z=nearer - 0.1)
    scene.put(second, farther, z=farther - 0.2)
    assert scene.front() == first


@pytest.mark.parametrize("kind", [LARGE, MEDIUM, SMALL])
@pytest.mark.parametrize(("first", "second"), [(0, 9), (9, 0)])
def test_of_two_birds_of_a_size_the_one_of_lower_depth_is_in_front(kind, first, second):
    scene = Scene()
    scene.put(first, kind, z=kind - 0.15)
    scene.put(second, kind, z=kind - 0.14)
    assert scene.front() == first


@pytest.mark.parametrize(("kind", "radius"), [(LARGE, 1.26), (MEDIUM, 0.84), (SMALL, 0.42)])
def test_a_bird_is_a_disc_of_radius_1_26_or_0_84_or_0_42(kind, radius):
    scene = Scene(place=(3.0, -2.0))
    for angle in (0.0, 1.0, 4.0):
        for distance, seen in ((radius - 1e-6, 0), (radius + 1e-6, NOTHING)):
            scene.put(0, kind, at=(3 + distance * math.cos(angle), -2 + distance * math.sin(angle)))
            assert scene.front() == seen


@pytest.mark.parametrize("place", [(9.5, -1.0), (7.0, -7.5)])
def test_through_a_barns_window_and_doors_small_birds_are_seen(place):
    scene = Scene(place=place, things=OBSTACLES)
    assert scene.front() == NOTHING
    scene.put(0, SMALL)
    assert scene.front() == 0


def test_only_the_obstacles_of_the_arenas_level_hide_and_are_sensed():
    scene = Scene(place=(5.0, 0.0), level=0, things=OBSTACLES)
    assert scene.front() == OBSTACLE and not scene.rays()[:, 2].any()
    scene.arena.level = 1
    assert scene.front() == NOTHING and scene.rays()[:, 2].all()


# --------------------------------------------------------------------------------------------------- rays


def direction(ray: int) -> Array:
    return np.array([math.cos(math.radians(30 * ray)), math.sin(math.radians(30 * ray))])


@pytest.mark.parametrize("ray", range(12))
def test_twelve_rays_go_counter_clockwise_from_x_in_steps_of_30_degrees(ray):
    bird, disc = (1.0, -2.0) + 5 * direction(ray), (1.0, -2.0) + 6 * direction(ray + 4)
    scene = Scene(place=(1.0, -2.0), things=obstacles(discs=[(*disc, 1.5)]))
    scene.put(4, LARGE, at=tuple(bird))
    rays = scene.rays()
    assert rays[:, 0] == only(ray, 5 - 1.26)
    assert rays[:, 1] == only(ray, 0.0)
    assert rays[:, 2] == only((ray + 4) % 12, 6 - 1.5)


def test_rays_do_not_turn_with_the_crosshairs_motion():
    scene = Scene(things=obstacles(boxes=[(3, -1, 5, 1)]))
    scene.put(0, at=(0.0, 4.0))
    before = scene.rays()
    scene.arena.vx, scene.arena.vy, scene.arena.heading = -30.0, 40.0, 2.0
    assert (scene.rays() == before).all()


@pytest.mark.parametrize(("edge", "distance"), [(13.999, 13.999), (14.001, -1.0)])
def test_a_ray_is_14_long(edge, distance):
    for things in (obstacles(boxes=[(edge, -2, edge + 2, 2)]), obstacles(discs=[(edge + 3, 0, 3)])):
        scene = Scene(things=things)
        scene.put(0, SMALL, at=(edge + 0.42, 0.0))
        assert scene.rays()[0] == pytest.approx([distance, 1.0 if distance > 0 else -1.0, distance], abs=1e-5)


def test_a_ray_does_not_meet_what_begins_within_14_beside_it_and_crosses_it_beyond():
    scene = Scene(things=obstacles(boxes=[(13, 4, 15, 9)], discs=[(-14.5, 1.2, 1.26)]))
    scene.put(0, LARGE, at=(14.5, 1.2))
    assert (scene.rays() == -1.0).all()


def test_a_ray_that_meets_nothing_reports_minus_1_three_times_and_walls_are_not_met():
    assert (Scene(place=(17.715, 10.215)).rays() == -1.0).all()


@pytest.mark.parametrize(
    ("box", "ray", "distance"),
    [
        ((3.0, 1.0, 5.0, 2.0), 1, 2 * math.sqrt(3)),  # enters through the left side, 1.73 high
        ((3.0, 2.0, 5.0, 3.0), 1, 4.0),  # enters through the bottom
        ((-5.0, -3.0, -3.0, -1.0), 7, 2 * math.sqrt(3)),
        ((-1.0, 4.0, 1.0, 6.0), 3, 4.0),
        ((-1.0, -6.0, 1.0, -4.0), 9, 4.0),
        ((2.0, -1.0, 3.0, 0.1), 0, 2.0),
    ],
)
def test_a_ray_meets_a_box_where_it_enters_it_and_no_other_ray_does(box, ray, distance):
    assert Scene(things=obstacles(boxes=[box])).rays()[:, 2] == only(ray, distance)


def test_rays_pass_by_a_box_beside_them():
    assert (Scene(things=obstacles(boxes=[(0.1, 4.0, 1.0, 6.0), (4.0, -1.0, 6.0, -0.1)])).rays() == -1.0).all()


def test_a_ray_reports_the_nearest_obstacle():
    things = obstacles(boxes=[(9, -1, 10, 1), (7, -1, 8, 1)], discs=[(5, 0, 1), (12, 0, 1)])
    assert Scene(things=things).rays()[0, 2] == pytest.approx(4.0, abs=1e-5)


@pytest.mark.parametrize("things", [obstacles(boxes=[(-1, -2, 3, 0.5)]), obstacles(discs=[(1, 0.5, 1.2)])])
def test_all_rays_that_start_inside_an_obstacle_report_distance_0(things):
    rays = Scene(things=things).rays()
    assert not rays[:, 2].any() and (rays[:, :2] == -1.0).all()


@pytest.mark.parametrize(("kind", "code"), [(LARGE, 0.0), (MEDIUM, 0.5), (SMALL, 1.0)])
def test_all_rays_that_start_inside_a_bird_report_distance_0_and_its_size(kind, code):
    scene = Scene()
    scene.put(2, kind, at=(0.3, 0.2))
    scene.put(1, (kind + 1) % 3, at=(5.0, 0.0))
    rays = scene.rays()
    assert not rays[:, 0].any() and (rays[:, 1] == code).all() and (rays[:, 2] == -1.0).all()


def test_rays_see_birds_through_obstacles_and_obstacles_through_birds():
    scene = Scene(things=obstacles(boxes=[(3, -1, 4, 1), (-9, -1, -8, 1)]))
    scene.put(0, MEDIUM, at=(8.0, 0.0))
    scene.put(1, LARGE, at=(-4.0, 0.0))
    rays = scene.rays()
    assert rays[0] == pytest.approx([8 - 0.84, 0.5, 3.0], abs=1e-5)
    assert rays[6] == pytest.approx([4 - 1.26, 0.0, 8.0], abs=1e-5)


@pytest.mark.parametrize(("kind", "code"), [(LARGE, 0.0), (MEDIUM, 0.5), (SMALL, 1.0)])
def test_the_size_code_is_that_of_the_nearest_bird_whatever_its_depth(kind, code):
    scene = Scene()
    for other in (LARGE, MEDIUM, SMALL):
        scene.put(other, other, at=(9.0, 0.0))
    scene.put(7, kind, at=(4.0, 0.0))
    assert scene.rays()[0, :2] == pytest.approx([4 - RADIUS[kind], code], abs=1e-5)


@pytest.mark.parametrize(("first", "second"), [(0, 9), (9, 0)])
def test_inside_several_birds_the_size_code_is_that_of_the_front_most(first, second):
    scene = Scene()
    scene.put(first, LARGE, at=(1.0, 0.0))
    scene.put(second, SMALL)
    rays = scene.rays()
    assert not rays[:, 0].any() and not rays[:, 1].any()
