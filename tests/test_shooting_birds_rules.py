"""The rules of Shooting Birds, number by number and tick by tick: walls, birds, depth, rays, gun, rewards, levels."""

import math
from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
import pytest

from joybridge.contract.tensors import Array
from joybridge.games.shooting_birds import rules as r
from joybridge.games.shooting_birds.game import CHANNELS
from joybridge.games.shooting_birds.levels import FLIGHTS, OBSTACLES, Obstacles
from joybridge.games.shooting_birds.sensing import cast_rays, front
from joybridge.simulator.randomness import open_streams, reserve

HIT, MISS, DRY_SHOT, RELOAD, AIMED_HIT, AIMED_MISS = range(6)
LARGE, MEDIUM, SMALL = range(3)
NOTHING, OBSTACLE = -1, -2
PAY = (0.25, 0.75, 2.0)  # of a large, a medium and a small bird
RADIUS = (1.26, 0.84, 0.42)
AWAY = 1000.0  # the height at which a bird meets nothing
NEAR = 1e-12
PLAIN = r.World(r.ORIGINAL, OBSTACLES, FLIGHTS, 0, -1, 0)

Point = tuple[float, float]


def obstacles(boxes: Iterable[tuple[float, ...]] = (), discs: Iterable[tuple[float, ...]] = ()) -> Obstacles:
    """Return a single level of boxes (left, bottom, right, top) and discs (x, y, radius) at depth 0."""
    box_rows, disc_rows = [(*box, 0.0) for box in boxes], [(*disc, 0.0) for disc in discs]
    return Obstacles(
        np.array(disc_rows, float).reshape(1, -1, 4),
        np.array([len(disc_rows)]),
        np.array(box_rows, float).reshape(1, -1, 5),
        np.array([len(box_rows)]),
    )


class Scene:
    """One arena, its birds far away and at rest but for those that a test puts somewhere, and its ticks."""

    def __init__(
        self,
        rules: r.Rules = r.ORIGINAL,
        place: Point = (0.0, 0.0),
        level: int = 0,
        ammo: int = 8,
        things: Obstacles | None = None,
    ) -> None:
        self.rules, self.streams = rules, open_streams(1, 0, 1)
        self.things = obstacles() if things is None else things
        self.world = r.World(rules, self.things, FLIGHTS, 0, -1, 0)
        self.arenas = np.zeros(1, r.ARENA).view(np.recarray)
        self.arena: Any = self.arenas[0]
        self.birds: Any = self.arenas.birds[0]
        self.birds.y = AWAY
        self.arena.x, self.arena.y = place
        self.arena.level, self.arena.ammo, self.arena.bird_speed = level, ammo, 1.0

    @property
    def place(self) -> Point:
        return float(self.arena.x), float(self.arena.y)

    @property
    def velocity(self) -> Point:
        return float(self.arena.vx), float(self.arena.vy)

    def put(self, bird: int = 0, kind: int = LARGE, at: Point | None = None, z: float | None = None) -> None:
        """Put a bird somewhere: at the crosshair, at the usual depth of its kind, if nothing else is said."""
        self.birds[bird].x, self.birds[bird].y = self.place if at is None else at
        self.birds[bird].kind = kind
        self.birds[bird].z = kind - 0.15 if z is None else z

    def tick(self, velocity: Point = (0.0, 0.0), shoot: int = 0, reload: int = 0, count: int = 1) -> Array:
        """Advance by some ticks and return the sum of their rewards per channel."""
        rewards = np.zeros((1, len(CHANNELS)))
        for _ in range(count):
            reserve(self.streams, r.MAX_DRAWS)
            action = np.array([velocity], float), np.array([shoot], np.int32), np.array([reload], np.int32)
            r.tick(self.arenas, self.streams, self.world, *action, rewards)
        return rewards[0]

    def coming(self, count: int) -> Array:
        """Return the random numbers, in [0, 1), that the next tick will draw first."""
        reserve(self.streams, r.MAX_DRAWS)
        begin = self.streams.cursor[0]
        return self.streams.values[0, begin : begin + count].copy()

    def front(self) -> int:
        return front(self.arena, self.things)

    def rays(self) -> Array:
        """Return bird distance, size code and obstacle distance of the twelve rays; distances in units, -1 for none."""
        rays = np.full((12, 3), np.nan, np.float32)
        cast_rays(self.arena, self.things, rays)
        return np.stack([np.where(rays[:, k] < 0, -1, rays[:, k] * (1 if k == 1 else 14)) for k in range(3)], axis=1)


def only(ray: int, distance: float) -> Any:
    """Return what the twelve rays measure if a single one of them meets something."""
    expected = np.full(12, -1.0)
    expected[ray] = distance
    return pytest.approx(expected, abs=1e-5)


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


# -------------------------------------------------------------------------------------------------- depth

PLACES = {"barn": (5.0, 0.0), "trunk": (-10.27, -5.0), "crown": (-13.5, 4.0), "open": (-2.0, 9.0)}  # of level 0
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


# -------------------------------------------------------------------------------------------------- birds


@pytest.fixture(scope="module")
def crowd() -> Any:
    """Return 4096 arenas as at the start of the program."""
    arenas = np.zeros(4096, r.ARENA).view(np.recarray)
    arenas.bird_speed = 1.0
    r.begin(arenas, open_streams(5, 0, len(arenas)), PLAIN)
    return arenas


def assert_uniform(values: Array, low: float, high: float) -> None:
    """Check that thousands of values fill a range, and its lower half with half of them."""
    assert low <= values.min() and values.max() <= high
    assert values.max() - values.min() > 0.99 * (high - low)
    assert np.mean(values < (low + high) / 2) == pytest.approx(0.5, abs=0.025)


def test_ten_birds_begin_at_the_left_or_the_right_edge_with_equal_chance_and_fly_to_the_other(crowd):
    birds = crowd.birds
    assert birds.shape == (4096, 10) and set(birds.x.ravel()) == {-19.7, 19.6}
    assert np.mean(birds.x < 0) == pytest.approx(0.5, abs=0.01)
    assert (np.sign(birds.vx) == -np.sign(birds.x)).all() and not birds.vy.any()


def test_new_birds_have_uniform_heights_speeds_and_phases(crowd):
    assert_uniform(crowd.birds.y, -8.48, 8.26)
    assert_uniform(abs(crowd.birds.vx), 1.5, 6.0)
    assert_uniform(crowd.birds.phase, -45.0, 45.0)


def test_new_birds_are_of_each_size_equally_often_and_their_depth_is_0_1_to_0_2_in_front_of_their_layer(crowd):
    kinds = np.bincount(crowd.birds.kind.ravel(), minlength=3) / crowd.birds.size
    assert kinds == pytest.approx([1 / 3] * 3, abs=0.01)
    assert_uniform(crowd.birds.kind - crowd.birds.z, 0.1, 0.2)


@pytest.mark.parametrize("factor", [0.5, 4.0])
def test_bird_speed_scales_the_speed_of_new_birds_and_nothing_else(crowd, factor):
    arenas = np.zeros(4096, r.ARENA).view(np.recarray)
    arenas.bird_speed = factor
    r.begin(arenas, open_streams(5, 0, len(arenas)), PLAIN)
    assert (arenas.birds.vx == factor * crowd.birds.vx).all()
    arenas.birds.vx, arenas.bird_speed = crowd.birds.vx, 1.0
    assert arenas.tobytes() == crowd.tobytes()


@pytest.mark.parametrize(("x", "leaves"), [(20.0, False), (-20.0, False), (20.0001, True), (-20.0001, True)])
def test_a_bird_beyond_20_is_replaced(x, leaves):
    scene = Scene()
    scene.birds[6].x = x
    scene.tick()
    assert (abs(scene.birds[6].y) <= 9.0) == leaves
    assert (abs(scene.birds[6].x) < 19.7) == leaves
    assert abs(np.delete(scene.birds.y, 6) - AWAY).max() < 1.0


def test_whether_a_bird_has_left_is_checked_before_it_moves():
    scene = Scene()
    scene.birds[0].x, scene.birds[0].vx = 19.9, 6.0
    scene.tick()
    assert scene.birds[0].x == pytest.approx(20.02, abs=NEAR)
    scene.tick()
    assert abs(scene.birds[0].x) < 19.7


def test_a_bird_that_replaces_one_flies_level_in_its_first_tick_and_moves_at_once():
    scene = Scene()
    scene.birds[0].x, scene.birds[0].phase = 21.0, 1.0
    side, height = scene.coming(2)
    scene.tick()
    assert scene.birds[0].vy == 0.0 and scene.birds[0].y == pytest.approx(-8.48 + 16.74 * height, abs=NEAR)
    start = -19.7 if side < 0.5 else 19.6
    assert scene.birds[0].x - start == pytest.approx(0.02 * scene.birds[0].vx, abs=NEAR)


def test_there_are_always_ten_birds_within_the_edges():
    arenas, streams = np.zeros(20, r.ARENA).view(np.recarray), open_streams(2, 0, 20)
    rewards = np.zeros((20, len(CHANNELS)))
    arenas.bird_speed = 4.0
    r.begin(arenas, streams, PLAIN)
    press, replaced = np.ones(20, np.int32), 0
    for _ in range(500):
        reserve(streams, r.MAX_DRAWS)
        before = arenas.birds.x.copy()
        r.tick(arenas, streams, PLAIN, np.zeros((20, 2)), press, press, rewards)
        replaced += int((abs(arenas.birds.x - before) > 1.0).sum())
        assert (abs(arenas.birds.x) <= 20 + 24 * 0.02).all() and (abs(arenas.birds.y) < 9.5).all()
        assert (abs(arenas.birds.vx) >= 6.0).all()
    assert replaced > 20 * 10


@pytest.mark.parametrize("clock", [0, 1, 157, 31415])
def test_birds_rise_and_fall_with_the_sine_of_twice_the_time_plus_their_phase(clock):
    scene = Scene()
    scene.arena.clock = clock
    scene.birds.phase, scene.birds.vx = np.linspace(-45, 45, 10), np.linspace(-6, 6, 10)
    scene.tick()
    expected = [math.sin(2 * 0.02 * clock + phase) for phase in scene.birds.phase]
    assert scene.birds.vy == pytest.approx(expected, abs=NEAR)
    assert scene.birds.y == pytest.approx(AWAY + 0.02 * np.array(expected), abs=1e-10)
    assert scene.birds.x == pytest.approx(0.02 * scene.birds.vx, abs=NEAR)
    assert scene.arena.clock == clock + 1


def test_birds_stay_within_1_of_their_first_height_and_swing_over_1_in_pi_seconds():
    scene = Scene()
    scene.birds.y, scene.birds.x, scene.birds.phase = 0.0, 10.0, np.linspace(-45, 45, 10)
    heights = np.empty((400, 10))
    for height in heights:
        scene.tick()
        height[:] = scene.birds.y
    assert abs(heights).max() <= 1.0 + 0.02
    assert np.ptp(heights, axis=0) == pytest.approx(np.ones(10), abs=0.01)
    assert abs(heights[157:314] - heights[:157]).max() < 0.01  # 157 ticks are pi seconds


@pytest.mark.parametrize("shot", [True, False])
def test_a_bird_that_replaces_one_keeps_its_phase(shot):
    scene = Scene()
    scene.birds[0].phase = 12.5
    if shot:
        scene.put()
    else:
        scene.birds[0].x = -20.5
    scene.tick(shoot=int(shot))
    assert scene.birds[0].phase == 12.5 and abs(scene.birds[0].x) > 19.4
    scene.tick()
    assert scene.birds[0].vy == pytest.approx(math.sin(0.04 + 12.5), abs=NEAR)


# ------------------------------------------------------------------------------------------------ episodes


def test_an_episode_begins_with_a_uniform_place_1_to_7_rounds_and_any_level(crowd):
    assert_uniform(crowd.x, -11.1, 8.9)
    assert_uniform(crowd.y, -10.0, 10.0)
    ammo, levels = np.bincount(crowd.ammo, minlength=9), np.bincount(crowd.level, minlength=7)
    assert ammo[0] == ammo[8] == 0 and ammo[1:8] / 4096 == pytest.approx([1 / 7] * 7, abs=0.02)
    assert len(levels) == 7 and levels / 4096 == pytest.approx([1 / 7] * 7, abs=0.02)


def test_a_new_episode_resets_crosshair_gun_level_and_counters_and_nothing_else():
    scene = Scene()
    scene.put()
    scene.tick((30.0, 40.0), shoot=1, count=9)
    scene.tick((3.0, 4.0), reload=1, count=3)
    assert all(scene.arena[name] for name in ("shots", "hits", "reloads", "tick"))
    scene.arena.level, scene.arena.fixed_level, scene.arena.heading = 9, -1, 1.5
    birds, draws = scene.birds.tobytes(), scene.coming(4)
    r.begin_episodes(scene.arenas, scene.streams)
    assert scene.place == pytest.approx((-11.1 + 20 * draws[0], -10 + 20 * draws[1]), abs=NEAR)
    assert (scene.arena.ammo, scene.arena.level) == (1 + int(7 * draws[2]), int(7 * draws[3]))
    assert [scene.arena[name] for name in ("shots", "hits", "reloads", "tick")] == [0] * 4
    assert scene.birds.tobytes() == birds and scene.arena.clock == 12
    assert scene.velocity == (3.0, 4.0) and scene.arena.heading == 1.5


def test_a_fixed_level_is_that_of_every_episode():
    arenas, streams = np.zeros(50, r.ARENA).view(np.recarray), open_streams(0, 0, 50)
    r.begin(arenas, streams, PLAIN._replace(fixed_level=4))
    assert (arenas.level == 4).all()
    r.begin_episodes(arenas, streams)
    assert (arenas.level == 4).all() and len(set(arenas.ammo)) > 1


# -------------------------------------------------------------------------------------------------- levels


def boxes_of(level: int) -> Array:
    return OBSTACLES.boxes[level, : OBSTACLES.box_count[level]]


def discs_of(level: int) -> Array:
    return OBSTACLES.discs[level, : OBSTACLES.disc_count[level]]


@pytest.mark.parametrize(
    ("level", "count", "total", "squares"),
    [
        (0, 18, 31.620, 4659.678),
        (1, 18, -240.080, 4659.678),
        (2, 24, -102.550, 5291.660),
        (3, 30, -207.010, 4911.042),
        (4, 18, 24.972, 4329.315),
        (5, 12, -76.897, 2497.950),
        (6, 24, -7.155, 20840.733),
    ],
)
def test_every_level_has_its_obstacles(level, count, total, squares):
    coordinates = np.concatenate([boxes_of(level)[:, :4].ravel(), discs_of(level)[:, :3].ravel()])
    assert len(boxes_of(level)) + len(discs_of(level)) == count
    assert coordinates.sum() == pytest.approx(total, abs=1e-3)
    assert (coordinates**2).sum() == pytest.approx(squares, rel=2e-6)  # from coordinates of four decimals


@pytest.mark.parametrize(
    ("level", "left", "bottom", "right", "top", "depth"),
    [
        (0, -11.57, -13.95, -8.97, -1.17, 1.1),  # a trunk
        (0, 2.3, 3.375, 5.2, 4.925, 0.0),  # a chimney
        (1, -5.2, 3.375, -2.3, 4.925, 0.0),  # the same, mirrored
        (1, -17.6, -5.51, -10.9, 3.47, 0.0),
        (2, -0.575, -8.945, 1.175, -6.435, 0.0),
        (3, -4.695, -10.8375, -2.745, -1.2525, 1.1),  # of the tree of three quarters
        (3, -14.265, -13.2462, -12.315, -0.658, 1.1),  # of the stretched and mirrored one
        (3, -6.82, -23.26, -4.22, -10.48, 1.1),
        (4, -3.5, -4.882, 5.74, 5.894, 0.0),
        (5, -0.9685, 2.588, 2.8145, 7.216, 0.0),
        (6, -18.0563, -0.1913, 19.2938, 2.2162, 0.0),  # foot of the upper barn
        (6, -18.0563, -2.2162, 19.2938, 0.1913, 0.0),  # and of the one upside down
        (6, -14.5125, -33.4688, -7.9875, -29.9812, 0.0),  # whose chimney is at the bottom
    ],
)
def test_a_levels_box_is_where_it_was_placed(level, left, bottom, right, top, depth):
    assert np.isclose(boxes_of(level), (left, bottom, right, top, depth), atol=6e-5).all(axis=1).sum() == 1


@pytest.mark.parametrize(
    ("level", "x", "y", "radius"),
    [
        (0, -12.33, 2.76, 2.66),
        (1, 12.33, 2.76, 2.66),  # mirrored
        (2, 11.53, -0.22, 2.04),
        (3, -5.265, 1.695, 1.995),
        (3, -11.745, 3.2131, 2.6201),  # stretched and mirrored: scaled by the larger of 0.75 and 0.985
        (3, -14.97, 3.3904, 2.955),
        (3, -15.3975, 0.2778, 2.0094),
        (3, 12.21, 1.05, 2.1),
        (4, -8.03, 6.41, 3.0),
    ],
)
def test_a_levels_disc_is_where_it_was_placed(level, x, y, radius):
    assert np.isclose(discs_of(level), (x, y, radius, 1.1), atol=6e-5).all(axis=1).sum() == 1


@pytest.mark.parametrize(
    ("level", "trees", "barns"), [(0, 1, 1), (1, 1, 1), (2, 2, 1), (3, 5, 0), (4, 1, 1), (5, 0, 1), (6, 0, 2)]
)
def test_a_barn_is_twelve_boxes_at_depth_0_and_a_tree_a_box_and_five_discs_at_depth_1_1(level, trees, barns):
    assert sorted(boxes_of(level)[:, 4]) == [0.0] * 12 * barns + [1.1] * trees
    assert discs_of(level)[:, 3].tolist() == [1.1] * 5 * trees
