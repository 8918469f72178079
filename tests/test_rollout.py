"""Stacking, waiting lanes and what reaches an update."""

import numpy as np

from joybridge.contract.codec import StepArrays
from joybridge.trainer.layouts import ActionSpace
from joybridge.trainer.ppo.distributions import FORBIDDEN
from joybridge.trainer.ppo.rollout import Rollout

LANES, STACK = 2, 3


def make_rollout(steps: int = 4) -> Rollout:
    rollout = Rollout(steps, LANES, 1, STACK, ActionSpace(1, (2,)))
    rollout.begin(np.array([[1.0], [10.0]], np.float32), None)
    return rollout


def add(rollout, frames, rewards=(0, 0), *, terminated=(False, False), truncated=(False, False), deciding=None):
    """Store one step in which the given lanes ended."""
    terminated, truncated = np.array(terminated), np.array(truncated)
    step = StepArrays(
        [], np.zeros((LANES, 1)), terminated, truncated,
        deciding=None if deciding is None else np.array(deciding),
        ended=np.flatnonzero(terminated | truncated).astype(np.int32),
    )  # fmt: skip
    rollout.add_step(step, np.array(frames, np.float32)[:, None], np.array(rewards, np.float32))


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
    final = rollout.final_stack(np.array([1]), np.array([[30.0]], np.float32))
    add(rollout, [3, 99], truncated=(False, True))
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
    np.testing.assert_array_equal(rollout.live()[:, 1], [True, False, False, True])
    assert rollout.live()[:, 0].all()


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
    rollout.final_values[1, 1] = 7.0
    add(rollout, [3, 30], truncated=(False, True), deciding=(True, False))
    np.testing.assert_array_equal(rollout.truncated[:, 1], [True, False, False, False])
    assert rollout.final_values[0, 1] == 7.0


def test_a_decision_still_open_at_the_end_is_left_out_of_the_batch():
    rollout = make_rollout(2)
    add(rollout, [2, 20], (1, 0), deciding=(True, False))
    add(rollout, [3, 30], (1, 0), deciding=(True, False))
    live = rollout.live()
    np.testing.assert_array_equal(live, [[True, False], [True, False]])
    batch = rollout.batch(np.array([[1, 0], [3, 0]], np.float32), live)
    np.testing.assert_allclose(batch.advantages, [-1, 1])
    np.testing.assert_array_equal(batch.observations, [[0, 0, 1], [0, 1, 2]])


def test_the_next_rollout_begins_where_the_last_ended():
    rollout = make_rollout(1)
    add(rollout, [2, 20])
    assert rollout.full
    after = make_rollout(1)
    after.continue_from(rollout)
    assert not after.full
    np.testing.assert_array_equal(after.observations[0], [[0, 1, 2], [0, 10, 20]])


def test_masks_are_kept_from_the_first_one_on():
    rollout = make_rollout()
    assert rollout.set_masks(None) is None
    add(rollout, [2, 20])
    row = rollout.set_masks([np.array([[True, False], [True, True]])])
    assert row is not None
    assert (row < 0.0).tolist() == [[[False, True]], [[False, False]]]
    add(rollout, [3, 30])
    row = rollout.set_masks(None)
    assert row is not None
    assert not row.any()


def test_parts_are_filled_at_their_own_pace_and_make_up_the_whole():
    whole, rollout = make_rollout(), make_rollout()
    parts = [rollout.part(slice(0, 1)), rollout.part(slice(1, 2))]
    frames = [[2, 20], [3, 30], [4, 40], [5, 50]]
    for row in frames:
        add(whole, row, (1, 2))
    for lane, part in enumerate(parts):
        for row in frames:
            zeros = np.zeros(1, bool)
            step = StepArrays([], np.zeros((1, 1)), zeros, zeros)
            part.add_step(step, np.array([[row[lane]]], np.float32), np.array([1.0 + lane], np.float32))
        assert part.full
    np.testing.assert_array_equal(rollout.observations, whole.observations)
    np.testing.assert_array_equal(rollout.rewards, whole.rewards)
    np.testing.assert_array_equal(rollout.live(), whole.live())


def test_masks_of_parts_are_joined_and_a_part_without_any_allows_everything():
    rollout = make_rollout()
    parts = [rollout.part(slice(0, 1)), rollout.part(slice(1, 2))]
    parts[1].set_masks([np.array([[True, False]])])
    rollout.join_masks(parts)
    assert rollout.masks is not None and rollout.masks.shape == (4, 2, 1, 2)
    assert (rollout.masks[0, 0] == 0).all() and rollout.masks[0, 1].tolist() == [[0.0, FORBIDDEN]]


def test_parts_without_masks_make_none():
    rollout = make_rollout()
    rollout.join_masks([rollout.part(slice(0, 1)), rollout.part(slice(1, 2))])
    assert rollout.masks is None
