"""The rules of Shooting Birds, number by number and tick by tick: crosshair, walls, gun and rewards."""

from typing import NamedTuple

import numpy as np
import pytest

from joybridge.games.shooting_birds import rules as r
from joybridge.games.shooting_birds.game import CHANNELS
from joybridge.games.shooting_birds.levels import FLIGHTS, OBSTACLES
from joybridge.simulator.randomness import open_streams
from tests.support.shooting_birds_scene import LARGE, MEDIUM, NEAR, PLACES, SMALL, Point, Scene, obstacles

HIT, MISS, DRY_SHOT, RELOAD, AIMED_HIT, AIMED_MISS = range(6)
PAY = (0.25, 0.75, 2.0)  # of a large, a medium and a small bird


# -------------------------------------------------------------------------------------- crosshair and walls


class Wall(NamedTuple):
    """One of the four walls: the axis across it, on which side it is, and how far its face is from the centre."""

    axis: int
    side: int
    face: float

    def vector(self, into: float, along: float = 0.0) -> Point:
        """Return the vector with these parts into and along the wall."""
        return (self.side * into, along) if self.axis == 0 else (along, self.side * into)

    def point(self, gap: float) -> Point:
        """Return the point at this distance from the middle of the wall's face."""
        return self.vector(self.face - gap)

    def gap(self, scene: Scene) -> float:
        """Return the distance from the crosshair's centre to the face."""
        return self.face - self.side * scene.place[self.axis]


RIGHT, LEFT, TOP, BOTTOM = Wall(0, 1, 19.0), Wall(0, -1, 19.0), Wall(1, 1, 11.5), Wall(1, -1, 11.5)
every_wall = pytest.mark.parametrize("wall", [RIGHT, LEFT, TOP, BOTTOM], ids=["right", "left", "top", "bottom"])


@pytest.mark.parametrize("velocity", [(50.0, 0.0), (0.0, -50.0), (30.0, 40.0), (-3.0, 4.0)])
def test_the_crosshair_moves_by_0_02_of_its_velocity_per_tick(velocity):
    scene = Scene(place=(1.0, 2.0))
    scene.tick(velocity)
    assert scene.place == pytest.approx((1 + 0.02 * velocity[0], 2 + 0.02 * velocity[1]), abs=NEAR)
    assert scene.velocity == velocity


def test_the_crosshair_stops_at_once_and_passes_through_birds_and_obstacles():
    scene = Scene(things=obstacles(boxes=[(-1, -1, 2, 2)], discs=[(1, 0, 2)]))
    scene.put()
    scene.tick((50.0, 25.0))
    assert scene.place == pytest.approx((1.0, 0.5), abs=NEAR) and scene.velocity == (50.0, 25.0)
    scene.tick()
    assert scene.place == pytest.approx((1.0, 0.5), abs=NEAR) and scene.velocity == (0.0, 0.0)


@every_wall
def test_a_fast_crosshair_sinks_one_unit_into_a_wall_that_it_did_not_touch(wall):
    scene = Scene(place=wall.point(gap=1.2901))
    scene.tick(wall.vector(into=50.0))
    assert wall.gap(scene) == pytest.approx(0.2901, abs=NEAR)


@every_wall
def test_a_crosshair_keeps_its_velocity_in_the_tick_in_which_it_sinks_in_and_loses_it_in_the_next(wall):
    scene = Scene(place=wall.point(gap=1.2901))
    scene.tick(wall.vector(into=50.0, along=40.0))
    assert scene.velocity == wall.vector(into=50.0, along=40.0)
    scene.tick(wall.vector(into=50.0, along=40.0))
    assert scene.velocity == pytest.approx(wall.vector(into=0.0, along=20.0), abs=NEAR)


@every_wall
@pytest.mark.parametrize(("gap", "kept"), [(1.2901, 10.0), (1.2899, 0.0)])
def test_a_wall_is_touched_from_a_distance_of_1_29(wall, gap, kept):
    scene = Scene(place=wall.point(gap))
    scene.tick(wall.vector(into=10.0))
    assert scene.velocity == wall.vector(into=kept)


@every_wall
def test_a_crosshair_in_a_wall_is_pushed_out_over_ticks_by_a_fifth_of_its_depth_three_times_each(wall):
    scene = Scene(place=wall.point(gap=0.3))
    for gap in (0.78068, 1.02678816, 1.15279554):  # 0.99 deep: pushed by 0.197, 0.1576 and 0.12608 ...
        scene.tick(wall.vector(into=50.0))
        assert wall.gap(scene) == pytest.approx(gap, abs=1e-8)


@every_wall
def test_one_push_is_at_most_0_2(wall):
    scene = Scene(place=wall.point(gap=0.0))
    scene.tick()
    assert wall.gap(scene) == pytest.approx(0.2 + 0.2 + 0.177, abs=NEAR)


@every_wall
def test_nothing_pushes_a_crosshair_that_is_less_than_0_005_deep(wall):
    scene = Scene(place=wall.point(gap=1.2851))
    before = scene.place
    scene.tick(count=10)
    assert scene.place == before


@every_wall
def test_the_push_leaves_the_velocity_alone_and_comes_on_top_of_the_way_out(wall):
    scene = Scene(place=wall.point(gap=0.29))
    scene.tick(wall.vector(into=-10.0))
    assert scene.velocity == wall.vector(into=-10.0)
    assert wall.gap(scene) == pytest.approx(1.285 - (0.995 - 0.2) * 0.8**3, abs=NEAR)


@pytest.mark.parametrize(("wall", "rest"), [(RIGHT, 17.715), (LEFT, 17.715), (TOP, 10.215), (BOTTOM, 10.215)])
def test_a_crosshair_that_is_held_against_a_wall_rests_where_the_position_sensor_ends(wall, rest):
    scene = Scene()
    scene.tick(wall.vector(into=50.0), count=60)
    assert scene.place == pytest.approx(wall.vector(rest), abs=1e-9) and scene.velocity == wall.vector(0.0)


@every_wall
@pytest.mark.parametrize(("along", "left_over"), [(40.0, 28.0), (-40.0, -28.0), (10.0, 0.0), (-12.0, 0.0)])
def test_a_wall_takes_the_normal_velocity_and_two_fifths_of_it_from_the_tangential(wall, along, left_over):
    scene = Scene(place=wall.point(gap=1.285))
    scene.tick(wall.vector(into=30.0, along=along))
    assert scene.velocity == pytest.approx(wall.vector(into=0.0, along=left_over), abs=NEAR)
    assert scene.place[1 - wall.axis] == pytest.approx(0.02 * left_over, abs=NEAR)


@every_wall
@pytest.mark.parametrize("into", [0.0, -30.0])
def test_a_wall_leaves_a_velocity_alone_that_does_not_point_into_it(wall, into):
    scene = Scene(place=wall.point(gap=1.285))
    scene.tick(wall.vector(into=into, along=40.0))
    assert scene.velocity == wall.vector(into=into, along=40.0)
    assert scene.place[1 - wall.axis] == pytest.approx(0.8, abs=NEAR)


@pytest.mark.parametrize(
    ("commanded", "left_over"),
    [((30.0, 40.0), (0.0, 0.0)), ((30.0, -40.0), (0.0, -28.0)), ((-30.0, 40.0), (-14.0, 0.0)), ((-3.0, -4.0),) * 2],
)
def test_in_a_corner_each_wall_takes_its_part(commanded, left_over):
    scene = Scene(place=(17.715, 10.215))
    scene.tick(commanded)
    assert scene.velocity == pytest.approx(left_over, abs=NEAR)


def test_in_a_corner_both_walls_push():
    scene = Scene(place=(-18.7, 11.0))
    scene.tick()
    assert scene.place == pytest.approx((-17.715 - 0.985 * 0.8**3, 10.215 + 0.785 * 0.8**3), abs=NEAR)


# ----------------------------------------------------------------------------------------- gun and rewards

every_rules = pytest.mark.parametrize("rules", [r.ORIGINAL, r.CORRECTED], ids=["original", "corrected"])


@every_rules
@pytest.mark.parametrize("hits", [True, False])
def test_a_shot_costs_one_round_whether_it_hits_or_not(rules, hits):
    scene = Scene(rules, ammo=5)
    if hits:
        scene.put()
    scene.tick(shoot=1)
    assert (scene.arena.ammo, scene.arena.shots, scene.arena.hits) == (4, 1, int(hits))


@every_rules
@pytest.mark.parametrize("where", ["barn", "crown", "open"])
def test_a_shot_at_an_obstacle_or_at_nothing_costs_a_tenth(rules, where):
    scene = Scene(rules, place=PLACES[where], things=OBSTACLES)
    if where != "open":
        scene.put(0, SMALL)  # behind it
    assert scene.tick(shoot=1)[: RELOAD + 1].tolist() == [0.0, -0.1, 0.0, 0.0]
    assert where == "open" or (scene.birds[0].kind == SMALL and abs(scene.birds[0].x) < 19)


@every_rules
def test_a_shot_of_an_empty_gun_costs_1_and_hits_nothing(rules):
    scene = Scene(rules, ammo=0)
    scene.put(0, SMALL)
    assert scene.tick(shoot=1)[: RELOAD + 1].tolist() == [0.0, 0.0, -1.0, 0.0]
    assert (scene.arena.ammo, scene.arena.shots, scene.arena.hits) == (0, 0, 0) and scene.birds[0].x == 0.0


@every_rules
@pytest.mark.parametrize("ammo", range(9))
def test_a_reload_costs_an_eighth_per_shot_left_and_fills_the_magazine_to_8(rules, ammo):
    scene = Scene(rules, ammo=ammo)
    assert scene.tick(reload=1).tolist() == [0.0, 0.0, 0.0, -ammo / 8, 0.0, 0.0]
    assert (scene.arena.ammo, scene.arena.reloads) == (8, 1)


@every_rules
def test_a_tick_without_a_button_pays_nothing(rules):
    scene = Scene(rules)
    scene.put()
    assert not scene.tick().any() and scene.arena.ammo == 8


@pytest.mark.parametrize(
    ("ammo", "shots", "dry_shot", "reload"),
    [(0, 0, -1.0, 0.0), (1, 1, 0.0, 0.0), (3, 1, 0.0, -0.25), (8, 1, 0.0, -0.875)],
)
def test_a_tick_with_both_buttons_shoots_before_it_reloads(ammo, shots, dry_shot, reload):
    scene = Scene(ammo=ammo)
    rewards = scene.tick(shoot=1, reload=1)
    assert (rewards[DRY_SHOT], rewards[RELOAD]) == (dry_shot, reload)
    assert (scene.arena.shots, scene.arena.reloads, scene.arena.ammo) == (shots, 1, 8)


def test_a_shot_is_judged_before_crosshair_and_birds_move():
    scene = Scene()
    scene.put(0, SMALL, at=(0.41, 0.0))
    scene.birds[0].vx = 6.0
    assert scene.tick((-50.0, 0.0), shoot=1)[HIT] > 0
    scene = Scene()
    scene.put(0, SMALL, at=(0.43, 0.0))
    scene.birds[0].vx = -6.0
    assert scene.tick((50.0, 0.0), shoot=1)[MISS] == -0.1


def test_only_the_front_most_of_several_birds_is_hit():
    scene = Scene(r.CORRECTED)
    for bird, kind in enumerate((SMALL, LARGE, MEDIUM)):
        scene.put(bird, kind)
    assert [scene.tick(shoot=1)[HIT] for _ in range(4)] == [0.25, 0.75, 2.0, 0.0]


@pytest.mark.parametrize("kind", [LARGE, MEDIUM, SMALL])
def test_in_the_corrected_game_a_hit_pays_by_the_size_of_the_bird_that_was_hit(kind):
    scene = Scene(r.CORRECTED)
    for _ in range(30):
        scene.arena.ammo = 1
        scene.put(0, kind)
        assert scene.tick(shoot=1)[HIT] == PAY[kind]


def test_in_the_original_a_hit_pays_by_the_size_that_the_replacing_bird_draws_third_of_five():
    scene, paid = Scene(), set()
    for _ in range(150):  # more than one block of random numbers
        scene.arena.ammo = 1
        scene.put(0, LARGE)
        side, height, size, depth, speed = scene.coming(5)
        paid.add(pay := scene.tick(shoot=1)[HIT])
        bird, kind = scene.birds[0], int(3 * size)
        assert pay == PAY[kind] and bird.kind == kind
        assert bird.vx == pytest.approx((1.5 + 4.5 * speed) * (1 if side < 0.5 else -1), abs=NEAR)
        assert bird.x == pytest.approx((-19.7 if side < 0.5 else 19.6) + 0.02 * bird.vx, abs=NEAR)
        assert bird.y == pytest.approx(-8.48 + 16.74 * height + 0.02 * bird.vy, abs=NEAR)
        assert bird.z == pytest.approx(kind - 0.1 - 0.1 * depth, abs=NEAR)
    assert paid == set(PAY)


@pytest.mark.parametrize("kind", [LARGE, MEDIUM, SMALL])
def test_in_the_original_a_hit_pays_1_on_average_and_each_size_a_third_of_the_time_whatever_was_hit(kind):
    arenas, streams = np.zeros(3000, r.ARENA).view(np.recarray), open_streams(8, 0, 3000)
    arenas.birds.kind, arenas.birds.z, arenas.ammo = kind, kind - 0.15, 8
    rewards, press = np.zeros((3000, len(CHANNELS))), np.ones(3000, np.int32)
    world = r.World(r.ORIGINAL, obstacles(), FLIGHTS, 0, -1, 0)
    r.tick(arenas, streams, world, np.zeros((3000, 2)), press, 0 * press, rewards)
    assert [np.mean(rewards[:, HIT] == pay) for pay in PAY] == pytest.approx([1 / 3] * 3, abs=0.03)
    assert rewards[:, HIT].mean() == pytest.approx(1.0, abs=0.04)


@every_rules
@pytest.mark.parametrize("kind", [LARGE, MEDIUM, SMALL])
def test_aiming_pays_by_the_true_size_of_the_bird_under_every_rules(rules, kind):
    scene = Scene(rules)
    scene.put(0, kind)
    assert scene.tick(shoot=1)[AIMED_HIT:].tolist() == [PAY[kind], 0.0]


@every_rules
def test_aiming_at_anything_else_costs_a_tenth(rules):
    assert Scene(rules).tick(shoot=1)[AIMED_HIT:].tolist() == [0.0, -0.1]
    barn = Scene(rules, place=PLACES["barn"], things=OBSTACLES)
    barn.put(0, SMALL)
    assert barn.tick(shoot=1)[AIMED_HIT:].tolist() == [0.0, -0.1]


@pytest.mark.parametrize(("rules", "paid"), [(r.ORIGINAL, 1), (r.CORRECTED, 0)], ids=["original", "corrected"])
def test_aiming_an_empty_gun_is_paid_in_the_original_only(rules, paid):
    scene = Scene(rules, ammo=0)
    assert scene.tick(shoot=1)[AIMED_HIT:].tolist() == [0.0, -0.1 * paid]
    scene.put(0, SMALL)
    assert scene.tick(shoot=1)[AIMED_HIT:].tolist() == [2.0 * paid, 0.0]
    assert scene.tick(reload=1)[AIMED_HIT:].tolist() == [0.0, 0.0]
