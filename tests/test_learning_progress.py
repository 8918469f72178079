"""Of several games, one whose rewards change is learned from more often than one whose rewards stay."""

import numpy as np
import pytest

from joybridge.layouts import ActionSpace
from joybridge.policy.learning_progress import MOST, LearningProgress
from joybridge.ppo.rollout import RolloutBuffer

KINDS = np.array([0, 0, 1, 1])  # which game each lane plays
ALWAYS = np.ones((50, 4), bool)


def watched(*rewards: tuple[float, float]) -> LearningProgress:
    """Return the progress after rollouts with the same reward of all decisions of a game: (of a, of b)."""
    progress = LearningProgress(["a", "b"], KINDS)
    for pair in rewards:
        progress.watch(np.tile(np.array(pair, np.float32)[KINDS], (50, 1)), ALWAYS)
    return progress


@pytest.mark.parametrize(
    ("rewards", "weights"),
    [
        ([], [1, 1]),
        ([(5, 9)] * 20, [1, 1]),  # neither changes
        ([(0, 0)] * 30 + [(1, 0)] * 5, [1.5, 0.5]),  # a gets better
        ([(1, 0)] * 30 + [(0, 0)] * 5, [1.5, 0.5]),  # a gets worse: it is being forgotten
        ([(0, 0)] * 30 + [(1, 1)] * 5, [1, 1]),
        ([(0, 0)] * 30 + [(3, -1)] * 5, [1.25, 0.75]),
    ],
)
def test_a_game_whose_rewards_change_weighs_more(rewards, weights):
    np.testing.assert_allclose(watched(*rewards).weights(), weights, rtol=1e-6)


def test_no_game_weighs_more_than_twice_and_none_less_than_half():
    kinds = np.arange(10)
    progress = LearningProgress([str(kind) for kind in kinds], kinds)
    for reward in [0.0] * 30 + [1.0] * 5:
        rewards = np.zeros((2, 10), np.float32)
        rewards[:, 0] = reward
        progress.watch(rewards, np.ones((2, 10), bool))
    np.testing.assert_allclose(progress.weights(), [MOST] + [0.5] * 9)


def test_only_what_was_decided_counts_and_is_learned_from():
    progress = watched(*[(0, 0)] * 30, *[(1, 0)] * 5)
    rng = np.random.default_rng(0)
    decided = rng.random((50, 4)) < 0.8
    times = progress.times(decided, rng)
    assert not times[~decided].any() and {*np.unique(times[decided])} == {0, 1, 2}
    assert times[:, :2][decided[:, :2]].min() == 1  # 1.5 times on average: once or twice
    row = progress.row(times)
    assert row["a.share"] == pytest.approx(0.75, abs=0.06) and row["a.share"] + row["b.share"] == pytest.approx(1)
    before = progress.state()
    progress.watch(np.full((50, 4), np.inf, np.float32), np.zeros((50, 4), bool))  # nothing was decided
    after = progress.state()
    assert all(np.array_equal(array, after[name]) for name, array in before.items())
    one = np.zeros((1, 4), bool)
    one[0, 3] = True
    for seed in range(20):  # half of the times it is rounded to nothing, and then it is learned from all the same
        assert progress.times(one, np.random.default_rng(seed)).sum() == 1


def test_a_batch_holds_each_timestep_as_often_as_it_is_learned_from():
    rollout = RolloutBuffer(3, [slice(0, 2)], 1, ActionSpace(1, ()))
    rollout.observations[:-1, :, 0] = [[0, 1], [2, 3], [4, 5]]
    decided = np.array([[True, True], [True, False], [True, True]])
    advantages = np.arange(6, dtype=np.float32).reshape(3, 2)
    batch = rollout.batch(advantages, decided, times=np.array([[0, 2], [1, 0], [3, 1]]), normalize=False)
    assert batch.observations.numbers[:, 0].tolist() == batch.advantages.tolist() == [1, 1, 2, 4, 4, 4, 5]
    once = rollout.batch(advantages, decided, times=decided.astype(int), normalize=False)
    assert once.advantages.tolist() == rollout.batch(advantages, decided, normalize=False).advantages.tolist()
