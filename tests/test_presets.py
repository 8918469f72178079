"""Presets, and what a network begins with under the settings of other programs."""

import numpy as np
import pytest
import torch

from joybridge.config.config import Config, dump_config, load_config
from joybridge.config.errors import ConfigError
from joybridge.config.keys import listing
from joybridge.config.policy_config import PolicyConfig
from joybridge.config.presets import PRESETS
from joybridge.layouts import make_layouts
from joybridge.policy.actor import make_actors
from joybridge.policy.config_fit import check_fit
from joybridge.simulator import axis, behavior, branch, sensor
from joybridge.v1 import bridge_pb2 as pb

PLAYER = behavior(
    "player",
    sensors=[sensor("seen", [6], -1, 1)],
    axes=[axis("x"), axis("y")],
    branches=[branch("act", ["a", "b", "c"])],
)
SPEC = pb.GameSpec(name="still", behaviors=[PLAYER])


def test_all_presets_set_the_same_keys_and_that_of_the_paper_is_the_default():
    keys = {name: (set(preset), set(preset["policy"])) for name, preset in PRESETS.items()}
    assert keys["sb3"] == keys["cleanrl"] == keys["paper"]
    assert Config(game="g", preset="paper") == Config(game="g").model_copy(update={"preset": "paper"})
    settled = Config(game="g", preset="sb3", policy={"epochs": 3})
    assert (settled.arenas, settled.policy.epochs, settled.policy.hidden_sizes) == (1, 3, [64, 64])
    assert all(any(f"preset={name}" in line for line in listing("preset")) for name in PRESETS)


def test_a_preset_stands_beneath_the_keys_beside_it_and_above_what_is_extended(tmp_path):
    (tmp_path / "common.yaml").write_text("game: g\narenas: 9\npolicy: {epochs: 7, gamma: 0.5, threads: 2}")
    path = tmp_path / "own.yaml"
    path.write_text("extends: common.yaml\npreset: sb3\npolicy: {gamma: 0.9}")
    config = load_config(path)
    assert (config.arenas, config.policy.epochs, config.policy.gamma, config.policy.threads) == (1, 10, 0.9, 2)
    over = load_config(path, ["preset=cleanrl", "policy.epochs=2"])
    assert (over.arenas, over.policy.epochs, over.policy.gamma, over.preset) == (4, 2, 0.99, "cleanrl")
    path.write_text(dump_config(config))
    assert load_config(path) == config
    with pytest.raises(ConfigError, match="preset: got 'rllib'"):
        load_config(path, ["preset=rllib"])


@pytest.mark.parametrize("layout", ["hybrid", "bucket-5"])
def test_orthogonal_weights_have_the_gains_of_the_others(layout):
    (actor,) = make_actors(Config(game="still", layout=layout, preset="sb3"), SPEC)
    network = actor.network
    for tower in (network.actor, network.critic):
        assert tower is not None
        for layer in tower.layers:
            short = layer.weight if len(layer.weight) <= layer.weight.shape[1] else layer.weight.T
            torch.testing.assert_close(short @ short.T, 2.0 * torch.eye(len(short)), atol=1e-5, rtol=0)
            assert not layer.bias.any()
    head = network.actor.head.weight
    torch.testing.assert_close(head @ head.T, 1e-4 * torch.eye(len(head)), atol=1e-9, rtol=0)
    assert network.critic is not None and network.critic.head.weight.norm().item() == pytest.approx(1.0, abs=1e-5)
    np.testing.assert_allclose(network.log_variance.detach().numpy(), 2 * np.log(3), rtol=1e-4)
    assert network.log_variance.numel() == make_layouts(layout, PLAYER.device)[""].space.continuous


@pytest.mark.parametrize("layout", ["hybrid", "squashed", "hybrid, x=beta", "hybrid, x=squashed"])
def test_deviations_begin_by_the_names_of_axes(layout):
    policy = PolicyConfig(log_std_init={"y": -0.5})
    (actor,) = make_actors(Config(game="still", layout=layout, policy=policy), SPEC)
    begun = actor.network.log_variance.tolist()
    assert begun[-1 if "beta" in layout else actor.gaussians.index("y")] == -1.0 and sum(map(bool, begun)) == 1


def test_the_deviations_of_gsde_are_those_of_its_coefficients():
    (actor,) = make_actors(Config(game="still", layout="gsde-2", policy=PolicyConfig(log_std_init={"y": 0.5})), SPEC)
    features = actor.network.shown
    assert actor.network.log_variance.tolist() == features * [0.0] + features * [0.5] and features == 100


@pytest.mark.parametrize(("layout", "known"), [("hybrid", "x, y"), ("beta", "none"), ("bucket-5", "none")])
def test_a_deviation_of_what_has_no_gaussian_is_refused(layout, known):
    policy = PolicyConfig(log_std_init={"jump": 1.0})
    for check in (check_fit, make_actors):
        with pytest.raises(ConfigError, match=f"log_std_init: 'jump' has no Gaussian; there are {known}"):
            check(Config(game="still", layout=layout, policy=policy), SPEC)
