"""What is odd in the rollouts of a run is said in one line, once, and nothing is said of what is not."""

import numpy as np
import pytest

from joybridge.config.config import Config
from joybridge.config.policy_config import PolicyConfig
from joybridge.policy.actor import make_actors
from joybridge.policy.policy import Policy
from joybridge.run.advice import SAME_DECISIONS, TAKEN_BACK, Adviser
from joybridge.run.lengths import intervals_too_short, too_few_updates
from joybridge.simulator import image
from joybridge.simulator.catalog import load_games
from joybridge.v1 import bridge_pb2 as pb
from tests.support.games import PLACES

LANES, STEPS = 50, 100
SPEC = load_games(PLACES)["hybrid"].describe({"size": "small", "masks": "off"})
ROLLOUTS = SAME_DECISIONS // (LANES * STEPS)
RNG = np.random.default_rng(0)


def lively(layout: str) -> tuple[Policy, Adviser]:
    """Return a policy whose rollout is as it should be, and who looks at it."""
    config = Config(game="hybrid", layout=layout, policy=PolicyConfig(rollout_steps=STEPS, frame_stack=2))
    (actor,) = make_actors(config, SPEC)
    policy = Policy(actor, SPEC.behaviors[0], [0, LANES])
    rollout = policy.rollout
    rollout.observations[:] = RNG.uniform(-1, 1, rollout.observations.shape)
    rollout.rewards[:] = RNG.uniform(-1, 1, rollout.rewards.shape)
    rollout.continuous[:] = RNG.normal(size=rollout.continuous.shape)
    for branch, size in enumerate(rollout.space.branches):
        rollout.discrete[..., branch] = RNG.integers(size, size=rollout.discrete.shape[:2])
    return policy, Adviser(policy, SPEC.behaviors[0])


def said(adviser: Adviser, rollouts: int = ROLLOUTS) -> list[str]:
    return [line for _ in range(rollouts) for line in adviser.look()]


@pytest.mark.parametrize("layout", ["hybrid", "bucket-5", "threshold-0.0"])
def test_nothing_is_said_about_a_lively_policy(layout):
    assert said(lively(layout)[1], 2 * ROLLOUTS) == []


def test_an_encoder_that_is_shared_in_spite_of_its_key_is_named_once():
    behavior = SPEC.behaviors[0]
    eye = pb.Behavior()
    eye.CopyFrom(behavior)
    eye.sensors.append(image("view", 16, 16))
    spec = pb.GameSpec(name="hybrid", behaviors=[eye])
    for body, lines in ((None, 1), (False, 0)):
        policy = PolicyConfig(shared_encoder=False, shared_body=body, rollout_steps=STEPS)
        (actor,) = make_actors(Config(game="hybrid", layout="bucket-5", policy=policy), spec)
        adviser = Adviser(Policy(actor, eye, [0, 2]), eye)
        found = [line for line in [*adviser.look(), *adviser.look()] if "shared_encoder=false does nothing" in line]
        assert len(found) == lines


def test_a_run_that_is_never_measured_or_less_often_than_it_says_is_named():
    during = {"every": 100}
    short = Config(game="hybrid", total_timesteps=1000, log_interval=5000, evaluate_during=during)
    rows, held_out = intervals_too_short(short)
    assert "log_interval is 5,000, longer than the run of 1,000 timesteps, so it will have no row of metrics" in rows
    assert "evaluate_during.every is 100, but" in held_out and "them, every 5,000 timesteps (log_interval)" in held_out
    for due in (None, {"every": 500}, {"every": None}):
        fine = Config(game="hybrid", total_timesteps=1000, log_interval=500, evaluate_during=due)
        assert not [*intervals_too_short(fine)]


def test_a_run_of_a_few_updates_is_named():
    (few,) = too_few_updates(Config(game="hybrid", total_timesteps=30_000))
    assert "30,000 timesteps are 6.8 updates of 4,425 (75 arenas, policy.rollout_steps 59), and a policy" in few
    assert not [*too_few_updates(Config(game="hybrid", total_timesteps=44_250))]


def test_an_update_that_changes_the_policy_beyond_sense_is_named_once():
    _, adviser = lively("hybrid")
    statistics = [{}, {"approx_kl": 0.2}, {"approx_kl": 512.0}, {"approx_kl": 900.0}]
    (line,) = [line for each in statistics for line in adviser.look_at_update(each)]
    assert "an update has an approx_kl of 512, where 0.01 to 0.05 is usual: " in line


def test_a_policy_that_becomes_less_certain_is_named_once():
    _, adviser = lively("hybrid")
    lines = [line for entropy in (0.8, 1.7, 2.7, 0.5, 4.3) for line in adviser.look_at_update({"entropy": entropy})]
    (line,) = lines
    assert "the entropy has risen from 0.8 to 2.7: the policy becomes less certain, " in line
    _, adviser = lively("hybrid")
    assert not [line for entropy in (4.5, 6.1, 3.0) for line in adviser.look_at_update({"entropy": entropy})]


@pytest.mark.parametrize(("share", "said"), [(0.995, 1), (0.98, 0)])
def test_a_policy_that_goes_on_choosing_at_random_is_named_once(share, said):
    policy, adviser = lively("bucket-5")
    largest = float(np.log(policy.rollout.space.branches).sum())
    lines = [line for _ in range(25) for line in adviser.look_at_update({"entropy": share * largest})]
    assert len(lines) == said
    assert all("after 50,000 decisions the entropy is still the largest that is possible (" in line for line in lines)
    for layout, first in (("bucket-5", 0.5 * largest), ("hybrid", largest)):  # it knows something; axes have no limit
        _, adviser = lively(layout)
        assert not [line for value in (first, *[largest] * 25) for line in adviser.look_at_update({"entropy": value})]


def test_a_sensor_with_large_numbers_is_named_once_with_the_largest():
    policy, adviser = lively("hybrid")
    frame = policy.actor.encoder.size  # place 2, count 1, image 4, lamps 3
    policy.rollout.observations[7, 3, frame + 5] = -255.0
    policy.rollout.observations[:, :, 2] = 99.0  # of an older frame: it has been seen as the newest before
    (line,) = said(adviser)
    assert line.startswith("player: sensor 'image' reaches 255; policies learn best from numbers of about -1 to 1")


def test_rewards_beyond_sense_are_named_once():
    policy, adviser = lively("hybrid")
    policy.rollout.rewards[5, 5] = -1e12
    (line,) = said(adviser)
    assert line.startswith("player: a decision is rewarded with up to ±1e+12;") and "policy.reward_weights" in line


@pytest.mark.parametrize(
    ("rewards", "ends", "same", "lines"),
    [
        ([1, 0, 2, 1, -4, 1], False, False, 1),
        ([1, 0, 2, 1, -4, 1], True, False, 0),
        ([1, 0, 2, 1, -4, 1], False, True, 0),  # a punishment
        ([1, 0, 2, 1, -3, 1], False, False, 0),
        ([1, -1, 2, -2, 1, -1], False, False, 0),
    ],
)
def test_a_score_that_falls_back_within_episodes_is_named_once(rewards, ends, same, lines):
    policy, adviser = lively("hybrid")
    policy.rollout.rewards[:] = 0.0
    sizes = np.ones(TAKEN_BACK) if same else np.arange(1, TAKEN_BACK + 1)
    policy.rollout.rewards[2:8, :TAKEN_BACK] = np.array(rewards)[:, None] * sizes
    policy.rollout.terminated[6, :TAKEN_BACK] = ends
    policy.rollout.truncated[-1] = True
    found = said(adviser, 3)
    assert len(found) == lines
    if found:
        assert found[0].startswith("player: one decision took back all that several before it had paid (4, 8, 12, …)")


@pytest.mark.parametrize(("punished", "lines"), [(8, 1), (10, 0)])
def test_a_game_that_punishes_takes_back_everything_at_times_by_chance(punished, lines):
    policy, adviser = lively("hybrid")
    policy.rollout.rewards[:] = 0.0
    policy.rollout.rewards[2:6, :TAKEN_BACK] = np.array([1, 2, 1, -4])[:, None] * np.arange(1, TAKEN_BACK + 1)
    policy.rollout.rewards[7, -punished:] = -1.0
    assert len(said(adviser, 3)) == lines


@pytest.mark.parametrize(("paid", "lines"), [(0.0, 1), (-0.5, 0)])
def test_a_game_that_has_never_paid_is_named_once(paid, lines):
    policy, adviser = lively("hybrid")
    policy.rollout.rewards[:] = 0.0
    policy.rollout.rewards[3, 3] = paid
    assert said(adviser, ROLLOUTS - 1) == []
    found = said(adviser, 2 * ROLLOUTS)
    assert len(found) == lines
    if found:
        assert found[0].startswith(
            f"player: none of {SAME_DECISIONS:,} decisions was rewarded, so nothing can be learned"
        )


@pytest.mark.parametrize(
    ("layout", "column", "never"), [("hybrid", 1, 0), ("bucket-5", 3, 1), ("threshold-0.0", 3, -1)]
)
def test_a_button_that_is_never_pressed_is_named_once_in_every_layout(layout, column, never):
    policy, adviser = lively(layout)
    target = policy.rollout.continuous if layout.startswith("threshold") else policy.rollout.discrete
    target[..., column] = never
    assert said(adviser, ROLLOUTS - 1) == []
    (line,) = said(adviser, 3)
    assert line.startswith(
        f"player: 'press' was never pressed in {SAME_DECISIONS:,} decisions; if this is not the best"
    )


def test_a_single_other_choice_begins_the_count_anew():
    policy, adviser = lively("hybrid")
    policy.rollout.discrete[..., 0] = 2
    assert said(adviser, ROLLOUTS - 1) == []
    policy.rollout.discrete[0, 0, 0] = 1
    assert said(adviser, 1) == []
    policy.rollout.discrete[..., 0] = 2
    assert said(adviser, ROLLOUTS - 1) == []
    assert said(adviser, 1)[0].startswith("player: 'gear' was always 'high' in 20,000 decisions")


def test_a_button_that_is_about_to_be_forgotten_is_named_at_the_first_sign():
    policy, adviser = lively("hybrid")
    assert said(adviser, 1) == []
    policy.rollout.discrete[..., 1] = 0
    policy.rollout.discrete[0, :, 1] = 1  # 50 of 5000: a hundredth
    assert said(adviser, 1) == []
    policy.rollout.discrete[0, 20:, 1] = 0
    (line,) = said(adviser, 3)
    assert line.startswith("player: 'press' is pressed in 0.4% of the decisions, after 1.0%: it may be forgotten")
    assert "policy.penalty_ramp" in line


def test_a_button_that_was_never_pressed_much_is_not_said_to_be_forgotten():
    policy, adviser = lively("hybrid")
    policy.rollout.discrete[..., 1] = 0
    policy.rollout.discrete[0, :20, 1] = 1
    assert said(adviser, 3) == []


def test_rows_in_which_nothing_was_decided_pay_nothing_again():
    policy, adviser = lively("hybrid")
    policy.rollout.rewards[:] = 1.0
    said(adviser, 1)
    policy.rollout.deciding[:] = False  # their rewards are those of the rollout before
    before = adviser._sums.copy()
    said(adviser, 1)
    assert (adviser._sums == before).all()
