"""A configuration trained by Stable-Baselines3: the arguments it means there, and the folder of such a run."""

import inspect
import math
from contextlib import nullcontext
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import gymnasium
import numpy as np
import pytest
import torch
from gymnasium.spaces import Box, Discrete
from stable_baselines3 import PPO
from stable_baselines3.common.env_util import make_vec_env

from joybridge.compare import sb3
from joybridge.compare.environments import check_spaces
from joybridge.compare.sb3 import arguments_of, main
from joybridge.compare.variants import Variant, beside
from joybridge.config.config import Config, load_config
from joybridge.config.config_files import find_config
from joybridge.config.errors import ConfigError
from joybridge.config.metrics import read_rows
from joybridge.ppo.continuous.gsde import GSDE
from joybridge.run.origin import run_origins

SMALL = (
    "arenas=2",
    "total_timesteps=256",
    "log_interval=64",
    "evaluate_during.episodes=3",
    "policy.rollout_steps=32",
    "policy.time_horizon=32",
    "policy.minibatch_size=32",
    "policy.epochs=1",
)


def test_the_preset_sb3_is_what_ppo_does_there_by_default():
    env = make_vec_env("Pendulum-v1", 1)
    arguments = arguments_of(Config(game="Pendulum-v1", preset="sb3"), env)
    defaults = {name: each.default for name, each in inspect.signature(PPO.__init__).parameters.items()}
    kwargs = arguments.pop("policy_kwargs")
    assert arguments == {name: defaults[name] for name in arguments} | {"seed": 0, "device": "cpu"}
    policy = PPO("MlpPolicy", env).policy
    assert kwargs["net_arch"] == [64, 64] and isinstance(policy.mlp_extractor.policy_net[1], kwargs["activation_fn"])
    assert kwargs["ortho_init"] == policy.ortho_init and kwargs["optimizer_kwargs"] == policy.optimizer_kwargs
    # As wide as half the range, which is 2 here; the deviation is 1 there, whatever the range.
    assert kwargs["log_std_init"] == pytest.approx(math.log(2), abs=1e-3)


@pytest.mark.parametrize(("entropy", "coefficient"), [("sum", 0.01), ("mean", 0.005)])
def test_entropy_is_the_sum_over_axes_there(entropy, coefficient):
    config = load_config(find_config("classic/lunarlander_continuous"), [f"policy.entropy={entropy}"])
    two_axes: Any = SimpleNamespace(action_space=Box(-1.0, 1.0, (2,)))
    assert arguments_of(config, two_axes)["ent_coef"] == coefficient


def test_gsde_explores_as_it_does_there():
    """The same features, coefficients and samples have the same log-probabilities and entropies."""
    env = make_vec_env("Pendulum-v1", 1)
    arguments = arguments_of(load_config(find_config("classic/pendulum"), ["seed=3"]), env)
    assert arguments["use_sde"] and arguments["sde_sample_freq"] == 4
    policy: Any = PPO("MlpPolicy", env, **arguments).policy
    seen = torch.rand(6, 3, generator=torch.Generator().manual_seed(1))
    with torch.no_grad():
        features = policy.mlp_extractor.forward_actor(policy.extract_features(seen))
        policy.reset_noise(6)
        theirs = policy.get_distribution(seen)
        samples = theirs.get_actions()
        gsde, log_std = GSDE(4, 64), policy.log_std[:, 0]
        outputs = torch.cat([policy.action_net(features).t(), features.t()])
        noise = (theirs.exploration_matrices[:, :, 0] / torch.exp(log_std)).t()
        torch.testing.assert_close(gsde.sample(outputs, log_std, noise), samples[:, 0])
        torch.testing.assert_close(gsde.log_prob(outputs, log_std, samples[:, 0]), theirs.log_prob(samples))
        torch.testing.assert_close(gsde.entropy(outputs, log_std), theirs.entropy())


def test_a_range_that_narrows_ends_there_where_it_ends_here():
    config = Config(game="CartPole-v1", preset="sb3", policy={"clip_range_schedule": "linear"})
    clip_range = arguments_of(config, make_vec_env("CartPole-v1", 1))["clip_range"]
    assert [clip_range(left) for left in (1.0, 0.5, 0.0)] == pytest.approx([0.2, 0.15, 0.1])


def test_schedules_end_where_ours_do_when_the_run_stops_earlier():
    falling = {"learning_rate": 2.5e-4, "learning_rate_schedule": "linear"}
    config = Config(game="CartPole-v1", preset="sb3", total_timesteps=1000, stop_at=500, policy=falling)
    rate = arguments_of(config, make_vec_env("CartPole-v1", 1))["learning_rate"]
    assert [rate(left) for left in (1.0, 0.0)] == pytest.approx([2.5e-4, 1.25e-4])


@pytest.mark.parametrize(
    "keys",
    [
        {"hand": {"delay": 1}},
        {"curriculum": [{"hand": {"delay": 1}}]},
        {"pointer": "velocity"},
        {"demonstrations": "demos"},
        {"weights_from": "run"},
    ],
)
def test_what_is_not_of_the_policy_and_has_no_argument_is_named(keys):
    with pytest.raises(ConfigError, match=f"cannot be set to this {next(iter(keys))}; begin with preset=sb3"):
        arguments_of(Config(game="CartPole-v1", preset="sb3", **keys), make_vec_env("CartPole-v1", 1))


@pytest.mark.parametrize(
    "keys",
    [
        {"frame_stack": 3},
        {"clip_vloss": True},
        {"memory": {"kind": "gru"}},
        {"sensors": ["observation"]},
        {"reward_weights": {"reward": 2.0}},
        {"penalty_ramp": 100},
        {"remember_acts": 2},
    ],
)
def test_what_ppo_has_no_argument_for_is_named(keys):
    with pytest.raises(ConfigError, match=f"cannot be set to this {next(iter(keys))}; begin with preset=sb3"):
        arguments_of(Config(game="CartPole-v1", preset="sb3", policy=keys), make_vec_env("CartPole-v1", 1))


@pytest.mark.parametrize("name", ["cartpole", "acrobot"])
def test_a_run_has_the_rows_of_ours_and_is_evaluated_at_its_end(name, tmp_path):
    assert main([str(find_config(f"classic/{name}")), "--run", str(tmp_path), *SMALL]) == 0
    rows = read_rows(tmp_path / "metrics-agent.csv")
    assert [row["timesteps"] for row in rows] == [64, 128, 192, 256]
    assert rows[-1]["held_out_episodes"] == 3 and "held_out_reward" not in rows[0]
    assert (tmp_path / "config.yaml").exists() and (tmp_path / "model.zip").exists()
    assert run_origins(tmp_path)[0].packages["stable_baselines3"]


def test_runs_of_two_seeds_are_evaluated_in_different_episodes(tmp_path, monkeypatch):
    made, seeds = sb3._environments, []

    def environments(environment, number, seed):
        seeds.append({*range(seed, seed + number)})
        return made(environment, number, seed)

    monkeypatch.setattr(sb3, "_environments", environments)
    for seed in (0, 1):
        run = tmp_path / f"{seed}"
        run.mkdir()
        assert main([str(find_config("classic/cartpole")), "--run", str(run), *SMALL, f"seed={seed}"]) == 0
    trained, evaluated, other_trained, other_evaluated = seeds
    assert len(evaluated) == 3 and not evaluated & (trained | other_trained | other_evaluated)


def test_a_game_that_is_no_environment_is_refused(tmp_path, capsys):
    assert main([str(find_config("archer/hybrid")), "--run", str(tmp_path), "preset=sb3"]) == 1
    assert "trains environments of Gymnasium here; there is no 'archer'" in capsys.readouterr().err


def test_an_environment_of_ones_own_is_imported_from_the_current_folder(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    Path("my_points.py").write_text(
        "import gymnasium\n"
        "from gymnasium.envs.classic_control.cartpole import CartPoleEnv\n"
        "gymnasium.register('MyPoints-v0', CartPoleEnv, max_episode_steps=50)\n"
    )
    config = Config(game="MyPoints-v0", preset="sb3")
    assert beside([Variant("a", config)], "sb3", ["gym:my_points:MyPoints-v0"])[0].by == "sb3"
    written = tmp_path / "points.yaml"
    written.write_text("{game: MyPoints-v0, preset: sb3}")
    run = ["--run", str(tmp_path / "run"), "--environment", "my_points:MyPoints-v0"]
    (tmp_path / "run").mkdir()
    assert main([str(written), *run, *SMALL]) == 0
    assert read_rows(tmp_path / "run" / "metrics-agent.csv")[-1]["held_out_length"] <= 50
    with pytest.raises(ConfigError, match=r"gets no settings \(gravity=1\)"):
        beside([Variant("a", config)], "sb3", ["gym:my_points:MyPoints-v0 gravity=1"])
    with pytest.raises(ConfigError, match="module 'nowhere' cannot be imported"):
        beside([Variant("a", Config(game="Own-v0"))], "sb3", ["gym:nowhere:Own-v0"])


def test_what_could_not_be_trained_there_is_refused_before_anything_is_trained():
    own = "tests.support.environments:Mixed-v0"
    with pytest.raises(
        ConfigError, match=f"takes actions of Box, Discrete, .*, and those of {own} are of Dict; flatten"
    ):
        beside([Variant("a", Config(game="Mixed-v0", preset="sb3"))], "sb3", [f"gym:{own}"])
    with pytest.raises(ConfigError, match="as the layouts hybrid and gsde-N do, not as bucket-5; compare layouts"):
        beside([Variant("a", Config(game="CartPole-v1", preset="sb3", layout="bucket-5"))], "sb3")
    with pytest.raises(ConfigError, match="cannot be set to this frame_stack, "):
        beside([Variant("a", Config(game="CartPole-v1"))], "sb3")


@pytest.mark.parametrize(("high", "image"), [(255, True), (9, False)])
def test_observations_that_it_takes_for_images_are_refused(high, image):
    class Pixels(gymnasium.Env):  # type: ignore[misc]
        observation_space = Box(0, high, (4, 4, 3), np.uint8)
        action_space = Discrete(2)

    gymnasium.register(f"Pixels{high}-v0", Pixels)
    try:
        with pytest.raises(ConfigError, match="are images, which get convolutions") if image else nullcontext():
            check_spaces(f"Pixels{high}-v0")
    finally:
        del gymnasium.registry[f"Pixels{high}-v0"]


def test_an_environment_that_lacks_a_package_names_it(monkeypatch):
    def lacking(**settings):
        import_module("imageio_of_nobody")

    monkeypatch.setitem(gymnasium.registry, "Lacking-v0", gymnasium.envs.registration.EnvSpec("Lacking-v0", lacking))
    with pytest.raises(ConfigError, match=r"'Lacking-v0' does not work: ModuleNotFoundError: .*imageio_of_nobody"):
        check_spaces("Lacking-v0")
