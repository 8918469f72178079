"""The levels of Shooting Birds: where their obstacles are."""

import numpy as np
import pytest

from joybridge.contract.tensors import Array
from joybridge.games.shooting_birds.levels import OBSTACLES


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
