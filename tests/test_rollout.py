"""Stacking, waiting lanes and what reaches an update."""

from collections.abc import Sequence

import numpy as np

from joybridge.contract.codec import StepArrays
from joybridge.layouts import ActionSpace
from joybridge.policy.encoder import final_observations, push_frames
from joybridge.ppo.distributions import FORBIDDEN
from joybridge.ppo.observation import Observation
from joybridge.ppo.rollout import RolloutBuffer

LANES, STACK = 2, 3


def make_rollout(steps: int = 4, groups: Sequence[slice] = (slice(0, LANES),)) -> RolloutBuffer:
    rollout = RolloutBuffer(steps, groups, STACK, ActionSpace(1, (2,)))
    for group, lanes in enumerate(groups):
        rollout.begin(Observation(np.array([[1.0], [10.0]], np.float32)[lanes]), None, group)
    return rollout


def add(
    rollout, frames, rewards=(0, 0), *, terminated=(False, False), truncated=(False, False), deciding=None, final=None
):
    """Store one step in which the given lanes ended."""
    terminated, truncated = np.array(terminated), np.array(truncated)
    step = StepArrays(
        [],
        np.zeros((LANES, 1)),
        terminated,
        truncated,
        deciding=None if deciding is None else np.array(deciding),
        ended=np.flatnonzero(terminated | truncated).astype(np.int32),
    )
    store(rollout, step, np.array(frames, np.float32)[:, None], np.array(rewards, np.float32), final)


def store(rollout, step, frames, rewards, final=None, group=0):
    t, lanes = rollout.rows[group], rollout.groups[group]
    push_frames(rollout.observations[t, lanes], frames, step, rollout.observations[t + 1, lanes])
    rollout.store(step, rewards, final, group)


def test_frames_stack_oldest_first_behind_zeros():
    rollout = make_rollout()
    add(rollout, [2, 20])
    add(rollout, [3, 30])
    add(rollout, [4, 40])
    np.testing.assert_array_equal(rollout.observations[0], [[0, 0, 1], [0, 0, 10]])
    np.testing.assert_array_equal(rollout.observations[3], [[2, 3, 4], [20, 30, 40]])


def test_an_end_clears_the_stack_and_the_final_one_holds_the_episodes_last_frames():
    rollout = make_rollout()
    add(rollout, [2, 20])
    truncated = np.array([False, True])
    step = StepArrays([], np.zeros((LANES, 1)), ~truncated, truncated, ended=np.array([1], np.int32))
    final = final_observations(rollout.observations[1], np.array([[30.0]], np.float32), step)
    add(rollout, [3, 99], truncated=truncated)
    np.testing.assert_array_equal(final, [[10, 20, 30]])
    np.testing.assert_array_equal(rollout.observations[2], [[1, 2, 3], [0, 0, 99]])


def test_a_waiting_lane_pushes_no_frame_and_is_paid_at_its_next_decision():
    rollout = make_rollout()
    add(rollout, [2, 20], (1, 0), deciding=(True, False))
    add(rollout, [3, 30], (1, 0), deciding=(True, False))
    add(rollout, [4, 40], (1, 7), deciding=(True, True))
    add(rollout, [5, 50], (1, 8))
    np.testing.assert_array_equal(rollout.observations[2, 1], [0, 0, 10])
    np.testing.assert_array_equal(rollout.observations[3, 1], [0, 10, 40])
    np.testing.assert_array_equal(rollout.rewards[:, 1], [7, 0, 0, 8])
    np.testing.assert_array_equal(rollout.decided()[:, 1], [True, False, False, True])
    assert rollout.decided()[:, 0].all()


def test_an_episode_that_ends_while_a_lane_waits_ends_its_last_decision():
    rollout = make_rollout()
    add(rollout, [2, 20], deciding=(True, False))
    add(rollout, [3, 30], (0, 5), terminated=(False, True), deciding=(True, False))
    add(rollout, [4, 40], deciding=(True, True))
    np.testing.assert_array_equal(rollout.rewards[:, 1], [5, 0, 0, 0])
    np.testing.assert_array_equal(rollout.terminated[:, 1], [True, False, False, False])
    np.testing.assert_array_equal(rollout.observations[3, 1], [0, 30, 40])


def test_a_truncation_while_a_lane_waits_leaves_its_final_value_at_its_last_decision():
    rollout = make_rollout()
    rollout.final_values[:] = 99.0  # of a rollout before
    add(rollout, [2, 20], deciding=(True, False))
    add(rollout, [3, 30], truncated=(False, True), deciding=(True, False), final=np.array([7.0], np.float32))
    np.testing.assert_array_equal(rollout.truncated[:, 1], [True, False, False, False])
    assert rollout.final_values[0, 1] == 7.0


def test_a_decision_still_open_at_the_end_is_left_out_of_the_batch():
    rollout = make_rollout(2)
    add(rollout, [2, 20], (1, 0), deciding=(True, False))
    add(rollout, [3, 30], (1, 0), deciding=(True, False))
    live = rollout.decided()
    np.testing.assert_array_equal(live, [[True, False], [True, False]])
    batch = rollout.batch(np.array([[1, 0], [3, 0]], np.float32), live)
    np.testing.assert_allclose(batch.advantages, [-1, 1])
    np.testing.assert_array_equal(batch.observations.numbers, [[0, 0, 1], [0, 1, 2]])


def test_the_next_rollout_begins_where_the_last_ended():
    rollout = make_rollout(1)
    add(rollout, [2, 20])
    assert rollout.full is True
    rollout.restart()
    assert rollout.rows == [0]
    np.testing.assert_array_equal(rollout.observations[0], [[0, 1, 2], [0, 10, 20]])


def masks_of(rollout: RolloutBuffer, allowed: list[list[bool]] | None, group: int = 0) -> np.ndarray | None:
    return rollout.mask(None if allowed is None else [np.array(allowed)], group)


def test_masks_are_kept_from_the_first_one_on():
    rollout = make_rollout()
    assert masks_of(rollout, None) is None
    add(rollout, [2, 20])
    row = masks_of(rollout, [[True, False], [True, True]])
    assert row is not None
    assert (row < 0.0).tolist() == [[[False, True]], [[False, False]]]
    add(rollout, [3, 30])
    row = masks_of(rollout, None)
    assert row is not None
    assert not row.any()


GROUPS = (slice(0, 1), slice(1, 2))


def test_groups_are_filled_at_their_own_pace_and_make_up_the_whole():
    whole, rollout = make_rollout(), make_rollout(groups=GROUPS)
    frames = [[2, 20], [3, 30], [4, 40], [5, 50]]
    for row in frames:
        add(whole, row, (1, 2))
    for lane in range(LANES):
        for row in frames:
            assert not rollout.full
            zeros = np.zeros(1, bool)
            step = StepArrays([], np.zeros((1, 1)), zeros, zeros)
            reward = np.array([1.0 + lane], np.float32)
            store(rollout, step, np.array([[row[lane]]], np.float32), reward, group=lane)
    assert rollout.full
    np.testing.assert_array_equal(rollout.observations, whole.observations)
    np.testing.assert_array_equal(rollout.rewards, whole.rewards)
    np.testing.assert_array_equal(rollout.decided(), whole.decided())


def test_a_lane_that_waits_in_the_second_group_gets_its_reward_at_its_own_decision():
    rollout = make_rollout(groups=GROUPS)
    zeros = np.zeros(1, bool)
    for deciding, reward in ((False, 0.0), (True, 5.0), (True, 1.0)):
        step = StepArrays([], np.zeros((1, 1)), zeros, zeros, deciding=np.array([deciding]))
        store(rollout, step, np.array([[2.0]], np.float32), np.array([reward], np.float32), group=1)
    np.testing.assert_array_equal(rollout.rewards, [[0, 5], [0, 0], [0, 1], [0, 0]])


def test_a_group_without_masks_allows_everything():
    rollout = make_rollout(groups=GROUPS)
    masks_of(rollout, [[True, False]], group=1)
    assert rollout.masks is not None and rollout.masks.shape == (4, 2, 1, 2)
    assert (rollout.masks[0, 0] == 0).all() and rollout.masks[0, 1].tolist() == [[0.0, FORBIDDEN]]


def test_noise_is_kept_for_as_many_decisions_as_it_is_to_be():
    rollout = make_rollout(steps=7)
    rollout.draw_noise(np.random.default_rng(5), np.array([1, 3]))
    own, kept = rollout.noise.normal.transpose(2, 0, 1)
    assert len(np.unique(own)) == own.size and len(np.unique(kept)) == 3 * LANES
    np.testing.assert_array_equal(kept[:6].reshape(2, 3, LANES), kept[[0, 3], None].repeat(3, 1))
    rollout.draw_noise(np.random.default_rng(5), np.array([1, 1]))
    np.testing.assert_array_equal(rollout.noise.normal[:, :, 0], own)
