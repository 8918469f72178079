"""The sensor of the four nearest birds in Shooting Birds: which it shows, in which order, and with which values."""

from typing import Any

import numpy as np
import pytest

from joybridge.contract.spec import check_spec, choose_options
from joybridge.games.shooting_birds.game import ShootingBirds
from joybridge.games.shooting_birds.levels import OBSTACLES
from tests.support.sweeps import sweep


def new_game(arenas: int = 1, **options: str) -> Any:
    chosen = choose_options(
        ShootingBirds.options, {"nearest_birds": "shown", "locomotion": "axes", **options}, "shooting_birds"
    )
    return ShootingBirds(chosen, {}, arenas, 0, 5)


def empty_sky(**options: str) -> Any:
    """Return a game of one arena whose crosshair is in the middle and whose birds are all above the screen."""
    game = new_game(1, **options)
    game.arenas.x = game.arenas.y = game.arenas.camera = 0.0
    game.arenas.birds.x, game.arenas.birds.y, game.arenas.birds.wait = 0.0, 12.0, 0
    game.arenas.birds.z = -1.0  # in front of everything
    return game


def nearest(game: Any) -> Any:
    (sensor,) = [values for values in game.observe()[0].observations if values.shape[1:] == (4, 6)]
    return sensor[0]


def test_the_nearest_come_first_relative_to_the_crosshair_with_velocity_and_size():
    game = empty_sky()
    game.arenas.x, game.arenas.y = 2.0, -1.0
    birds = game.arenas.birds
    birds.x[0, :5], birds.y[0, :5] = (-8.0, 3.0, 2.0, 12.0, -18.0), (1.0, -1.0, 4.0, 0.0, 8.0)
    birds.vx[0, :5], birds.vy[0, :5], birds.kind[0, :5] = (4.0, -2.0, 5.0, -3.0, 1.0), (0.5, -0.5, 1.0, 0.0, 0.0), 1
    birds.kind[0, 1:3] = 0, 2
    expected = [
        [1.0, 0.1, 0.0, -0.2, -0.05, 0.0],
        [1.0, 0.0, 0.5, 0.5, 0.1, 1.0],
        [1.0, 1.0, 0.1, -0.3, 0.0, 0.5],
        [1.0, -1.0, 0.2, 0.4, 0.05, 0.5],
    ]
    assert nearest(game) == pytest.approx(np.array(expected))


def test_birds_that_wait_or_are_beside_the_screen_are_not_shown():
    game = empty_sky(camera="edge")
    game.arenas.camera = game.arenas.x = 30.0
    game.arenas.birds.x[0, :4], game.arenas.birds.y[0, :4] = (10.9, 11.1, 48.8, 30.0), 0.0
    game.arenas.birds.wait[0, 3] = 7
    shown = nearest(game)
    assert shown[:, 0].tolist() == [1.0, 1.0, 0.0, 0.0] and not shown[2:].any()
    assert shown[:2, 1] == pytest.approx([1.88, -1.89])


def test_a_bird_behind_an_obstacle_is_not_shown_and_one_in_front_of_it_is():
    game = empty_sky(level="0")
    left, bottom, right, top, depth = OBSTACLES.boxes[0, 0][:5]
    game.arenas.birds.x[0, 0], game.arenas.birds.y[0, 0] = (left + right) / 2, (bottom + top) / 2
    game.arenas.birds.z[0, 0] = depth + 0.5
    assert not nearest(game).any()
    game.arenas.birds.z[0, 0] = depth - 0.5
    assert nearest(game)[:, 0].tolist() == [1.0, 0.0, 0.0, 0.0]


@pytest.mark.parametrize("options", [{}, {"camera": "drag", "hints": "on", "birds": "mixed", "levels": "generated"}])
def test_the_sensor_is_part_of_the_spec_and_keeps_its_bounds(options):
    game = new_game(3, **options)
    spec = game.describe(
        choose_options(
            ShootingBirds.options, {"nearest_birds": "shown", "locomotion": "axes", **options}, "shooting_birds"
        )
    )
    check_spec(spec)
    sensors = spec.behaviors[0].sensors
    assert [sensor.name for sensor in sensors][4] == "nearest_birds"
    sweep(game, 150, spec.behaviors[0].device)
    for sensor, values in zip(sensors, game.observe()[0].observations, strict=True):
        assert values.shape == (3, *sensor.shape)
        assert (values >= sensor.low[0]).all() and (values <= sensor.high[0]).all()


def test_birds_that_flee_faster_than_the_sensor_shows_are_shown_at_its_bound():
    game = empty_sky()
    game.arenas.birds.x[0, 0], game.arenas.birds.y[0, 0] = 1.0, 0.0
    game.arenas.birds.vx[0, 0], game.arenas.birds.vy[0, 0] = 128.0, -128.0
    assert nearest(game)[0, 3:5].tolist() == [10.0, -10.0]
