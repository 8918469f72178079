"""Images made from pictures: each pixel is an exact mean, and what lies beyond the picture is marked."""

from fractions import Fraction

import numpy as np
import pygame
import pytest

from joybridge.games.marble.game import OBSERVATIONS, PIXELS, Marble
from joybridge.simulator.sight import BEYOND, fovea, shrink


@pytest.mark.parametrize(("height", "width"), [(3, 5), (7, 9), (14, 18), (1, 1)])
def test_a_pixel_is_the_mean_of_what_it_covers(height, width):
    picture = np.random.default_rng(0).integers(0, 256, (7, 9, 3)).astype(np.uint8)
    small = shrink(picture, height, width, 3)
    across, down, zero = Fraction(9, width), Fraction(7, height), Fraction(0)
    for i in range(height):
        for j in range(width):
            total = Fraction(0)
            for y in range(7):
                for x in range(9):
                    high = min((i + 1) * down, Fraction(y + 1)) - max(i * down, Fraction(y))
                    wide = min((j + 1) * across, Fraction(x + 1)) - max(j * across, Fraction(x))
                    total += max(high, zero) * max(wide, zero) * int(picture[y, x, 1])
            assert abs(small[i, j, 1] - total / (across * down)) <= Fraction(1, 2)


def test_a_surface_gives_what_its_pixels_give():
    pixels = np.random.default_rng(0).integers(0, 256, (6, 8, 3)).astype(np.uint8)
    surface = pygame.surfarray.make_surface(pixels.swapaxes(0, 1))
    assert (shrink(surface, 3, 4, 3) == shrink(pixels, 3, 4, 3)).all()
    assert shrink(surface, 3, 4).shape == (3, 4, 1)


def test_a_square_around_a_point_marks_what_lies_beyond_the_picture():
    picture = np.full((10, 10, 3), 200, np.uint8)
    picture[5, 5] = 0
    assert (fovea(picture, 6, 6, 3, 6, 3)[2, 2] == 0).all()
    corner = fovea(picture, 0, 0, 3, 6)[:, :, 0]
    assert (corner[:3] == BEYOND).all() and (corner[:, :3] == BEYOND).all() and (corner[3:, 3:] > 150).all()
    assert (fovea(picture, 500, -500, 3, 6) == BEYOND).all()


@pytest.mark.parametrize("observation", OBSERVATIONS)
def test_marble_observes_what_its_spec_says(observation):
    game = Marble()
    game.option, game.parameter, game.rng = {"observation": observation}, {}, np.random.default_rng(0)
    (hand,) = Marble.describe(game.option).behaviors
    seen = game.reset().observation
    assert list(seen) == [sensor.name for sensor in hand.sensors]
    for sensor in hand.sensors:
        assert np.shape(seen[sensor.name]) == tuple(sensor.shape)


def test_the_marble_is_in_the_middle_of_its_square():
    game = Marble()
    game.option, game.parameter, game.rng = {"observation": "fovea"}, {}, np.random.default_rng(0)
    game.reset()
    squares = []
    for tilt in (0.0, 1.0):
        for _ in range(8):
            square = game.step({"tilt_x": tilt, "tilt_y": -tilt / 2}).observation["fovea"]
        squares.append(np.asarray(square).astype(int))
    for square in squares:
        blue = square[:, :, 2] - square[:, :, 0] > 60
        rows, columns = np.nonzero(blue)
        assert abs(rows.mean() - PIXELS / 2) < 2 and abs(columns.mean() - PIXELS / 2) < 2
