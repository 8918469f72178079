"""Advantages against closed forms."""

import numpy as np
import pytest

from joybridge.ppo.gae import gae

GAMMA, LAM = 0.9, 0.8


def estimate(rewards, values, last=0.0, *, terminated=(), truncated=(), final=0.0, deciding=None, time_horizon=99):
    """Return the advantages of one lane as a list; ends are given by their steps."""
    steps = len(rewards)
    flags = {name: np.isin(np.arange(steps), at)[:, None] for name, at in (("t", terminated), ("c", truncated))}
    column = np.array(rewards, np.float32)[:, None]
    advantages = gae(
        column,
        np.array(values, np.float32)[:, None],
        np.array([last], np.float32),
        flags["t"],
        flags["c"],
        np.where(flags["c"], np.float32(final), 0).astype(np.float32),
        np.ones((steps, 1), bool) if deciding is None else np.array(deciding)[:, None],
        gamma=GAMMA,
        gae_lambda=LAM,
        time_horizon=time_horizon,
    )
    assert advantages.dtype == np.float32
    return advantages[:, 0].tolist()


def test_a_single_final_reward_decays_by_gamma_lambda():
    expected = [(GAMMA * LAM) ** (4 - t) for t in range(5)]
    assert estimate([0, 0, 0, 0, 1], [0] * 5, terminated=[4]) == pytest.approx(expected)


def test_with_lambda_1_it_would_be_the_return_minus_the_value():
    rewards, values = [1.0, 2.0, 3.0], [0.5, 0.25, 2.0]
    deltas = [1 + GAMMA * 0.25 - 0.5, 2 + GAMMA * 2 - 0.25, 3 + GAMMA * 4 - 2]
    expected = [sum((GAMMA * LAM) ** (k - t) * deltas[k] for k in range(t, 3)) for t in range(3)]
    assert estimate(rewards, values, last=4.0) == pytest.approx(expected)


def test_termination_has_no_future_and_stops_what_comes_from_later():
    assert estimate([1, 5], [2, 3], last=7, terminated=[0])[0] == pytest.approx(1 - 2)


def test_truncation_is_continued_by_the_value_of_the_final_observation():
    assert estimate([1, 5], [2, 3], last=7, truncated=[0], final=10)[0] == pytest.approx(1 + GAMMA * 10 - 2)


def test_a_horizon_cuts_the_sum_and_keeps_the_value():
    cut = estimate([1] * 6, [0.5] * 6, last=0.5, time_horizon=2)  # the last of three cuts is at the end anyway
    delta = 1 + GAMMA * 0.5 - 0.5
    assert cut == pytest.approx([delta * (1 + GAMMA * LAM), delta] * 3)


def test_a_lane_that_waits_is_skipped():
    waiting = estimate([1, 0, 2], [0.5, 99, 0.25], last=4.0, deciding=[True, False, True])
    together = estimate([1, 2], [0.5, 0.25], last=4.0)
    assert waiting == pytest.approx([together[0], 0.0, together[1]])


def test_an_end_while_waiting_belongs_to_the_decision_before():
    waiting = estimate([1, 0, 2], [0.5, 99, 0.25], last=4.0, deciding=[True, False, True], terminated=[0])
    assert waiting[0] == pytest.approx(1 - 0.5)
