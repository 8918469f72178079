"""From what a device was given back to a policy's actions: the reverse of what layouts write."""

import numpy as np
import pytest

from joybridge.contract.codec import ActArrays
from joybridge.layouts import AxisRange, AxisTable, JointTable, Layout, make_layouts
from joybridge.layouts.layout import CLIP, together
from joybridge.layouts.targets import Split, Threshold
from tests.test_actions import make_device

DEVICE = make_device([(-1, 1), (2, 6)], [2, 3])


def act_of(axes: list[list[float]], choices: list[list[int]]) -> ActArrays:
    return ActArrays(np.array(axes, np.float32), np.array(choices, np.int32))


@pytest.mark.parametrize("name", ["hybrid", "bucket-5", "joint-3", "threshold-0.0", "threshold-0.5", "multiagent"])
def test_what_a_layout_has_written_is_read_as_an_action_that_writes_the_same(name):
    layout = together(*make_layouts(name, DEVICE).values())
    rng, lanes = np.random.default_rng(0), 200
    continuous = rng.normal(0, 2, (lanes, layout.space.continuous)).astype(np.float32)
    discrete = np.stack([rng.integers(size, size=lanes) for size in layout.space.branches] or [np.zeros(lanes, int)], 1)
    given, again = (act_of([[0, 2]] * lanes, [[0, 0]] * lanes) for _ in range(2))
    layout.write(continuous, discrete, given)
    read_continuous, read_discrete = layout.read(given)
    layout.write(read_continuous, read_discrete, again)
    np.testing.assert_allclose(again.axes, given.axes, atol=1e-5)
    np.testing.assert_array_equal(again.choices, given.choices)
    if layout.space.branches:
        np.testing.assert_array_equal(read_discrete, discrete)


def test_continuous_actions_are_read_in_the_middle_of_what_acts_alike():
    layout = Layout(
        (AxisRange(0, -1.0, 1.0), AxisRange(1, 2.0, 6.0), Threshold(0, 0.0), Threshold(0, 0.5), Split(1, 3))
    )
    act = act_of([[-1, 2], [0.5, 5], [1, 6], [2, 9]], [[0, 0], [1, 1], [0, 2], [1, 2]])
    continuous, discrete = layout.read(act)
    assert discrete.shape == (4, 0)
    wanted = [
        [-1, -1, -0.5, 0.75, -2 / 3],
        [0.5, 0.5, 0.5, 0, 0],
        [1, 1, -0.5, 0.75, 2 / 3],
        [1, 1, 0.5, 0, 2 / 3],
    ]
    np.testing.assert_allclose(continuous, CLIP * np.array(wanted), rtol=1e-6)


def test_the_nearest_value_of_an_axis_is_read_whatever_order_its_values_have():
    layout = Layout(discrete=(AxisTable(1, np.array([6, 2, 3], np.float32)),))
    _, discrete = layout.read(act_of([[0, 2.4], [0, 2.6], [0, 4.4], [0, 4.6], [0, -9], [0, 99]], [[0, 0]] * 6))
    assert discrete[:, 0].tolist() == [1, 2, 2, 0, 1, 0]


def test_a_joint_choice_has_most_of_the_choices_and_then_the_nearest_place_as_shares_of_each_span():
    values = np.array([[0, 0], [1, 0], [1, 0], [1, 1]], np.int32)
    places = np.array([[0, 2], [0, 2], [1, 6], [0, 2]], np.float32)
    table = JointTable((0, 1), values, (0, 1), places)
    act = act_of([[0, 2], [0.9, 4.5], [0.6, 3.9], [0, 5.9], [0, 2]], [[0, 0], [1, 0], [1, 0], [1, 2], [1, 1]])
    _, discrete = Layout(discrete=(table,)).read(act)
    # (0.6, 3.9) is nearer to the second place, of a span of 1 by 4, by a quarter of the first axis; (1, 2) has no row.
    assert discrete[:, 0].tolist() == [0, 2, 2, 1, 3]


def test_many_lanes_are_compared_with_the_places_in_parts():
    places = np.linspace(-1, 1, 41, dtype=np.float32)[:, None]
    table = JointTable((0,), np.ones((41, 1), np.int32), (0,), places)
    wanted = np.random.default_rng(1).integers(41, size=3000)
    act = ActArrays(np.pad(places[wanted], ((0, 0), (0, 1))), np.ones((3000, 2), np.int32))
    np.testing.assert_array_equal(Layout(discrete=(table,)).read(act)[1][:, 0], wanted)


def test_a_continuous_action_that_would_be_forbidden_is_given_the_first_allowed_choice():
    act = act_of([[0, 2]] * 4, [[0, 0]] * 4)
    masks = [np.array([[True, True]] * 4), np.array([[True] * 3, [False, True, True], [True, False, True], [True] * 3])]
    Layout((Split(1, 3),)).write(CLIP * np.array([[-1.0], [-0.9], [0.0], [1.0]]), np.zeros((4, 0)), act, masks)
    assert act.choices[:, 1].tolist() == [0, 1, 0, 2]
