"""Sine, cosine, arc cosine and arctangent: their precision, and the same bits for numbers and arrays."""

import math

import numpy as np
import pytest

from joybridge.simulator.trigonometry import arccosine, arctangent, cosine, sine


@pytest.mark.parametrize(("ours", "theirs"), [(sine, math.sin), (cosine, math.cos)], ids=["sine", "cosine"])
def test_sine_and_cosine_are_right_to_1e_12_up_to_1e4(ours, theirs):
    angles = np.concatenate([np.linspace(-1e4, 1e4, 20_001), np.arange(-6366, 6367) * (math.pi / 2)])
    expected = np.array([theirs(angle) for angle in angles])
    assert abs(ours(angles) - expected).max() < 1e-12


def test_sine_of_a_number_and_of_an_array_have_the_same_bits():
    angles = np.linspace(-300.0, 300.0, 997)
    assert np.array([sine(angle) for angle in angles]).tobytes() == sine(angles).tobytes()
    assert np.array([cosine(angle) for angle in angles]).tobytes() == cosine(angles).tobytes()


def test_arc_cosine_is_right_to_1e_14_over_its_whole_range():
    values = [*np.linspace(-1.0, 1.0, 20_001).tolist(), 1.0 - 1e-15, -1.0 + 1e-15]
    assert max(abs(arccosine(value) - math.acos(value)) for value in values) < 1e-14


def test_the_arctangent_is_right_to_1e_15_in_all_quadrants_and_exact_on_the_axes():
    angles = np.linspace(-math.pi, math.pi, 10_001)[1:]
    sides = [(1e3 * math.sin(angle), 1e3 * math.cos(angle)) for angle in angles]
    assert max(abs(arctangent(y, x) - math.atan2(y, x)) for y, x in sides) < 1e-15
    exact = [(0.0, 0.0), (0.0, 2.0), (0.0, -2.0), (2.0, 0.0), (-2.0, 0.0)]
    assert [arctangent(y, x) for y, x in exact] == [math.atan2(y, x) for y, x in exact]
