"""How the paper's page compares: means, variances, p values and margins."""

import math

import pytest
from scipy.stats import ttest_ind

from tools.paper.statistics import (
    EQUIVALENCE,
    FAILS,
    HOLDS,
    UNDECIDED,
    Sample,
    above,
    above_effect,
    above_p,
    alike,
    alike_effect,
    alike_p,
    differ,
    interquartile_mean,
    interval,
    margin,
    pooled,
    sample,
    steadier,
    steadier_effect,
    variance_p,
    welch_p,
)
from tools.paper.tables import place

pytestmark = pytest.mark.no_cover  # of tools, which are not measured


def test_one_run_has_no_interval_and_the_interval_of_several_contains_their_mean():
    assert interval([5.0]) is None
    low, high = interval([1.0, 2.0, 6.0]) or (0.0, 0.0)
    assert 1.0 <= low < 3.0 < high <= 6.0
    assert interval([1.0, 2.0, 6.0]) == (low, high)  # the same page every time


def test_the_interquartile_mean_leaves_out_the_outer_quarters():
    assert interquartile_mean([1.0, 2.0, 4.0, 100.0]) == 3.0
    assert interquartile_mean([1.0, 2.0, 6.0]) == 3.0


def samples(*means: float, std: float = 3.0, runs: int = 3) -> list[Sample]:
    return [Sample(mean, std, runs, runs - 1) for mean in means]


@pytest.mark.parametrize(
    ("rule", "means", "word"),
    [
        (above, [(20,), (10, 12)], HOLDS),
        (above, [(20,), (10, 19)], UNDECIDED),
        (above, [(20,), (10, 40)], FAILS),
        (above, [(20, 30), (10,)], HOLDS),
        (above, [(20, 11), (10,)], UNDECIDED),
        (above, [(20, 0), (10,)], FAILS),
        (alike, [(10, 11), (12,)], HOLDS),
        (alike, [(10, 11, 30), ()], FAILS),
    ],
)
def test_means_differ_only_beyond_their_margin(rule, means, word):
    first, second = (samples(*each) for each in means)
    assert rule(first, second) == word


@pytest.mark.parametrize("first", [20.0, 16.0, 14.0, 5.0])
def test_the_p_value_of_a_higher_mean_is_that_of_the_t_test_and_agrees_with_the_verdict(first):
    values, others = [first, first + 2, first + 5], ([8.0, 10.0, 12.0], [9.0, 11.0])
    samples = [sample(values)], [sample(each) for each in others]
    expected = max(ttest_ind(values, each, equal_var=False).pvalue for each in others)
    assert above_p(*samples) == (1.0 if first < 8 else pytest.approx(expected))
    assert (above_p(*samples) < 0.05) == (above(*samples) == HOLDS)


def test_the_difference_is_that_of_the_pair_of_the_p_value_with_its_interval():
    values, near, far = [20.0, 22.0, 25.0], [14.0, 18.0, 19.0], [2.0, 3.0]
    low, high = ttest_ind(values, near, equal_var=False).confidence_interval(0.95)
    middle = (sum(values) - sum(near)) / 3
    assert above_effect([sample(values)], [sample(far), sample(near)]) == pytest.approx((middle, low, high))
    low, high = ttest_ind(values, far, equal_var=False).confidence_interval(0.95)
    assert alike_effect([sample(each) for each in (far, near, values)], [])[1:] == pytest.approx((low, high))


def test_the_interval_of_a_ratio_of_deviations_ends_where_the_f_test_begins_to_reject():
    calm, wild = Sample(0.0, 2.0, 5, 4), Sample(0.0, 6.0, 8, 7)
    ratio, low, high = steadier_effect([calm], [wild])
    assert ratio == pytest.approx(3.0)
    for end in (low, high):
        assert variance_p(Sample(0.0, 2.0 * end, 5, 4), wild) == pytest.approx(0.05)


def test_means_are_equivalent_if_the_90_percent_interval_of_their_difference_is_within_the_bound():
    pair = [sample([10.0, 12.0, 14.0, 17.0]), sample([14.0, 15.0, 18.0, 24.0])]
    values = ttest_ind([14.0, 15.0, 18.0, 24.0], [10.0, 12.0, 14.0, 17.0], equal_var=False)
    reach = values.confidence_interval(0.9).high
    assert (alike_p(pair, []) < 0.05) == (reach < EQUIVALENCE)
    other = Sample(pair[1].mean + EQUIVALENCE - reach, pair[1].std, 4, 3)
    assert alike_p([pair[0], other], []) == pytest.approx(0.05)
    assert alike_p([*pair, sample([40.0, 41.0])], []) > 0.5  # the farthest pair counts


def test_means_with_a_large_standard_deviation_are_not_alike():
    assert alike(samples(10, 11, std=20), []) == UNDECIDED
    assert alike(samples(10, 19, std=4), []) == UNDECIDED  # the interval of the difference exceeds ten points


def test_fewer_runs_have_a_larger_margin():
    one, other = samples(10, 20, std=4)
    assert margin(one, other) == pytest.approx(9.067, abs=1e-3)  # t of 4 degrees of freedom at 97.5 %: 2.776
    assert margin(*samples(10, 20, std=4, runs=10)) == pytest.approx(3.758, abs=1e-3)  # 18: 2.101
    assert margin(one, Sample(1.0, 0.0, 3, 0)) == pytest.approx(9.937, abs=1e-3)  # 2: 4.303; the other is exact
    assert margin(*samples(1, 2, std=0)) == 0.0


def test_the_standard_deviation_of_a_few_runs_is_pooled_with_that_of_many():
    both = pooled(sample([10.0, 14.0]), Sample(50.0, 4.0, 10, 9))
    assert (both.mean, both.runs, both.freedom) == (12.0, 2, 10)
    assert both.std == pytest.approx(math.sqrt((8.0 + 9 * 16.0) / 10))
    assert pooled(sample([10.0]), Sample(50.0, 4.0, 10, 9)) == Sample(10.0, 4.0, 1, 9)


@pytest.mark.parametrize(("calm", "wild", "word"), [(1, 10, HOLDS), (3, 3, UNDECIDED), (10, 1, FAILS)])
def test_stability_compares_variances(calm, wild, word):
    assert steadier(samples(1, 2, 3, std=calm), samples(1, 2, 3, std=wild)) == word


@pytest.mark.parametrize(("reward", "word"), [(10.0, "inside"), (14.0, "above"), (5.0, "**below**")])
def test_a_run_lies_inside_above_or_below_two_standard_deviations(reward, word):
    assert place(reward, (9.0, 10.0, 11.0)) == word


def test_the_mean_of_several_runs_has_a_smaller_margin_than_that_of_one():
    theirs = Sample(100.0, 5.0, 10, 9)
    assert not differ(sample([111.8]), theirs)  # Student's t of 9 degrees of freedom, 2.262, times 5 times sqrt(1.1)
    assert differ(sample([111.9]), theirs)
    assert differ(sample([106.0, 105.0, 106.0, 107.0]), theirs)


def test_p_values_are_those_of_the_t_and_f_distributions():
    # t = 4 / sqrt(0.5 + 16/3) with 2.382 degrees of freedom; F = 6.4 with (2, 4), whose tail is (1 + F/2)^-2
    a, b = sample([1.0, 2.0, 3.0, 4.0, 5.0]), sample([3.0, 7.0, 11.0])
    assert welch_p(a, b) == pytest.approx(0.21924, abs=1e-5) == welch_p(b, a)
    assert variance_p(a, b) == pytest.approx(2 / 4.2**2) == variance_p(b, a)
