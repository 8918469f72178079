"""The estimators of comparisons: the numbers of rliable, and of the tests that textbooks print."""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import PermutationMethod, mannwhitneyu

from joybridge.compare.estimators import (
    bootstrap,
    estimate,
    holm,
    interquartile_mean,
    mann_whitney,
    performance_profile,
    probability_of_improvement,
)

RLIABLE = json.loads((Path(__file__).parent / "data/rliable.json").read_text())
SCORES = {name: np.array(scores) for name, scores in RLIABLE["scores"].items()}  # [runs, tasks] each


@pytest.mark.parametrize("name", SCORES)
def test_the_interquartile_mean_and_its_interval_are_those_of_rliable(name):
    found = estimate(interquartile_mean, SCORES[name], seed=3, resamples=2000)
    np.testing.assert_allclose(found, RLIABLE["iqm"][name], atol=1e-9, rtol=0)


@pytest.mark.parametrize("names", RLIABLE["improvement"])
def test_the_probability_of_improvement_and_its_interval_are_those_of_rliable(names):
    first, second = (SCORES[name] for name in names)
    found = estimate(probability_of_improvement, first, second, seed=5, resamples=1000)
    np.testing.assert_allclose(found, RLIABLE["improvement"][names], atol=1e-9, rtol=0)


@pytest.mark.parametrize("name", SCORES)
def test_the_performance_profile_and_its_intervals_are_those_of_rliable(name):
    thresholds = np.array(RLIABLE["thresholds"])
    found = bootstrap(lambda drawn: performance_profile(drawn, thresholds), SCORES[name], seed=11, resamples=1000)
    np.testing.assert_allclose(found, RLIABLE["profile"][name], atol=1e-9, rtol=0)


def test_another_seed_gives_another_interval_of_the_same_value():
    one, other = (estimate(interquartile_mean, SCORES["x"], seed=seed) for seed in (0, 1))
    assert one.value == other.value and (one.low, one.high) != (other.low, other.high)


def test_a_single_run_is_its_own_interval():
    assert estimate(interquartile_mean, np.array([[2.5]])) == (2.5, 2.5, 2.5)


def test_holms_correction_multiplies_by_the_number_of_tests_that_are_left_and_keeps_the_order():
    # By hand: sorted 0.005, 0.01, 0.03, 0.04 are multiplied by 4, 3, 2, 1; the last may not be below the one before.
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert holm([0.6, 0.9]) == [1.0, 1.0]
    assert holm([]) == []


def test_the_mann_whitney_test_is_exact_without_ties():
    assert mann_whitney([1, 2, 3, 4], [5, 6, 7, 8]) == pytest.approx(2 / 70)  # of 70 ways to choose 4 ranks of 8
    assert mann_whitney([1, 4], [2, 3]) == 1.0


def test_the_mann_whitney_test_is_exact_with_ties_and_equal_scores_have_1():
    assert mann_whitney([1, 1, 1], [2, 2, 2]) == pytest.approx(2 / 20)  # of 20 ways to choose 3 of 6
    assert mann_whitney([2, 1], [2, 2, 2]) == pytest.approx(2 * 4 / 10)  # 4 of 10 ways choose the lower value
    assert mann_whitney([3, 3], [3, 3, 3]) == 1.0


@pytest.mark.parametrize(
    ("first", "second"),
    [([1, 1, 1, 5, 6], [2, 2, 2, 7, 8]), ([0.5, 1, 1], [1, 2, 3, 3, 3]), ([1, 4, 2.5, 8, 9], [3, 5, 6, 7, 10, 11])],
)
def test_the_mann_whitney_test_is_that_of_all_permutations_in_scipy(first, second):
    every = mannwhitneyu(first, second, method=PermutationMethod(n_resamples=np.inf)).pvalue
    assert mann_whitney(first, second) == pytest.approx(every)
    assert mann_whitney(second, first) == pytest.approx(every)
