"""What a policy sees and earns is scaled alike in training, after a resumption, in evaluation and in exports."""

import numpy as np
import pytest

from joybridge.config.config import Config
from joybridge.config.errors import CheckpointError, ConfigError
from joybridge.config.policy_config import PolicyConfig
from joybridge.play.playing import PlaySpec, open_play
from joybridge.policy.scaling import LIMIT, Scaling, make_scaling
from joybridge.ppo.moments import Moments
from joybridge.ppo.return_scale import ReturnScale
from joybridge.run.checkpoint import load_checkpoint
from joybridge.run.train import train
from joybridge.simulator import sensor

LANES, ROLLOUT = 4, 16
LARGEST = float(np.finfo(np.float32).max)


def test_moments_of_parts_are_those_of_all_rows_even_far_from_0():
    rows = np.random.default_rng(0).normal(1e6, 3.0, (500, 4)).astype(np.float32)
    moments = Moments(4)
    for part in np.split(rows, [1, 7, 7, 300]):
        moments.add(part)
    np.testing.assert_allclose(moments.mean, rows.mean(0, dtype=np.float64), rtol=1e-12)
    np.testing.assert_allclose(moments.deviation(), rows.std(0, dtype=np.float64), rtol=1e-6)


def test_bounds_become_1_and_what_has_none_stays_as_it_is():
    sensors = [
        sensor("place", [2], -9.0, [9.0, 0.0]),
        sensor("image", [2], dtype=np.uint8),
        sensor("free", [1]),
        sensor("huge", [1], -LARGEST, LARGEST),
        sensor("lamp", [1], dtype=bool),
    ]
    scaling = make_scaling("player", "bounds", sensors)
    assert scaling is not None
    frames = np.array([[-9.0, 0.0, 51.0, 255.0, 7.0, -8.0, 1.0], [9.0, -4.5, 0.0, 102.0, 99.0, 0.0, 0.0]], np.float32)
    wanted = [[-1.0, 1.0, -0.6, 1.0, 7.0, -8.0, 1.0], [1.0, 0.0, -1.0, -0.2, 99.0, 0.0, -1.0]]
    np.testing.assert_allclose(scaling.apply(frames), wanted, atol=1e-6)
    assert scaling.apply(frames).dtype == np.float32
    with pytest.raises(ConfigError, match=r"but no sensor has any \(free\); set scale_observations=running"):
        make_scaling("player", "bounds", [sensor("free", [1])])


def test_running_moments_count_from_the_next_rollout_only():
    scaling = make_scaling("player", "running", [sensor("place", [1])])
    assert scaling is not None
    rows = np.array([[2.0], [6.0]], np.float32)
    scaling.watch(rows)
    np.testing.assert_array_equal(scaling.apply(rows), rows)
    scaling.refresh()
    np.testing.assert_allclose(scaling.apply(rows), [[-1.0], [1.0]])
    assert scaling.apply(np.array([[1e9]], np.float32)) == LIMIT


def test_rewards_are_divided_by_the_deviation_of_the_discounted_returns_of_all_episodes():
    rewards = np.array([[1.0, 4.0], [2.0, 0.0], [3.0, -4.0]], np.float32)
    ended, decided = np.zeros((3, 2), bool), np.ones((3, 2), bool)
    ended[1, 0], decided[1, 1] = True, False
    scale = ReturnScale(2, gamma=0.5)
    returns = [1.0, 4.0, 2.5, 3.0, -2.0]  # lane 0 begins anew after its second decision; lane 1 waits once
    np.testing.assert_allclose(scale.scale(rewards, decided, ended), rewards / np.std(returns), rtol=1e-5)
    again = ReturnScale(2, gamma=0.5)
    again.load(scale.state())
    returns += [3.0 / 2 + 1.0, -1.0 + 4.0]
    later = np.array([[1.0, 4.0]], np.float32), decided[:1], ended[:1]
    np.testing.assert_allclose(again.scale(*later), later[0] / np.std(returns), rtol=1e-5)


def run_of(rollouts: int, **policy) -> Config:
    small = {"rollout_steps": ROLLOUT, "time_horizon": ROLLOUT, "minibatch_size": 32, "hidden_sizes": [8]}
    return Config(
        game="shooting_birds",
        layout="bucket-3",
        arenas=LANES,
        total_timesteps=LANES * ROLLOUT * 4,
        log_interval=64,
        stop_at=LANES * ROLLOUT * rollouts,
        policy=PolicyConfig.model_validate(small | policy),
    )


def test_a_resumed_run_scales_to_the_same_bits_and_play_scales_as_training_did(simulator, tmp_path):
    scaled = {"scale_observations": "running", "scale_rewards": True}
    for run, stops in (("whole", [4]), ("parts", [1, 4])):
        for stop in stops:
            train(run_of(stop, **scaled), tmp_path / run, [simulator], resume=stop != stops[0])
    whole, parts = (load_checkpoint(tmp_path / run)[0] for run in ("whole", "parts"))
    assert whole.keys() == parts.keys()
    for name, array in whole.items():
        np.testing.assert_array_equal(parts[name], array, err_msg=name)
    moments = {name.rpartition(".")[2]: array for name, array in whole.items() if ".scaling." in name}
    assert moments["count"] == LANES * (4 * ROLLOUT + 1) and whole["hunter/policy/returns.count"] == LANES * 4 * ROLLOUT
    with open_play(PlaySpec(tmp_path / "whole", simulator, seed=0)) as play:
        (player,) = play.players
        scaling, (step,) = player.actor.scaling, play.session.steps
        assert isinstance(scaling, Scaling)
        np.testing.assert_array_equal(scaling.shift, moments["mean"].astype(np.float32))
        frames = player.actor.encoder.frames(step.observations)
        far = (frames - moments["mean"]) / np.sqrt(moments["squares"] / moments["count"] + 1e-8)
        np.testing.assert_allclose(
            player.actor.see(step.observations).numbers, far.clip(-LIMIT, LIMIT), rtol=1e-4, atol=1e-4
        )
    other = run_of(4).model_copy(update={"weights_from": str(tmp_path / "whole")})
    with pytest.raises(CheckpointError, match="does not fit: scale_observations was running, now none"):
        train(other, tmp_path / "other", [simulator], resume=False)
