"""How birds and episodes of Shooting Birds begin, how birds fly, and when they are replaced."""

import math
from typing import Any

import numpy as np
import pytest

from joybridge.contract.tensors import Array
from joybridge.games.shooting_birds import rules as r
from joybridge.games.shooting_birds.game import CHANNELS
from joybridge.games.shooting_birds.levels import FLIGHTS, OBSTACLES
from joybridge.simulator.randomness import open_streams, reserve
from tests.support.shooting_birds_scene import AWAY, NEAR, Scene

PLAIN = r.World(r.ORIGINAL, OBSTACLES, FLIGHTS, 0, -1, 0)


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
