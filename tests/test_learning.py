"""Every kind of action space is learned where the answer is known, over real sockets, in seconds."""

from pathlib import Path

import pytest

from joybridge.client.launch import simulator_process
from joybridge.config.config import Config, load_config
from joybridge.config.policy_config import PolicyConfig
from joybridge.play.evaluate import evaluate
from joybridge.play.playing import PlaySpec
from joybridge.run.train import train
from tests.support.learning_games import LENGTH

pytestmark = pytest.mark.slow

FAST = PolicyConfig(
    frame_stack=1,
    hidden_sizes=[32, 32],
    rollout_steps=16,
    time_horizon=16,
    minibatch_size=128,
    epochs=6,
    learning_rate=5e-3,
    entropy_coef=0.001,
)


@pytest.fixture(scope="module")
def address():
    games = [
        f"tests.support.learning_games:{name}" for name in ("Discrete", "Continuous", "Hybrid", "Far", "Shown", "Moles")
    ]
    with simulator_process(games) as bound:
        yield bound


def learn(address: str, run: Path, game: str, layout: str, timesteps: int, **more) -> float:
    """Return the share of the highest possible reward that the trained policy reaches."""
    policies = more.pop("policies", {})
    config = Config(
        game=game,
        layout=layout,
        arenas=32,
        total_timesteps=timesteps,
        log_interval=timesteps,
        policy=FAST.model_copy(update=more),
        policies=policies,
    )
    train(config, run, [address], resume=False)
    scores = evaluate(PlaySpec(run, address, seed=5, deterministic=True), episodes=64, say=lambda _: None)
    return min(score.means["reward"] for score in scores.values()) / LENGTH


@pytest.mark.parametrize(
    ("game", "layout", "timesteps", "wanted"),
    [  # hybrid with branches only and with axes only: orchard and marble in test_small_games.py
        ("identity_discrete", "bucket-3", 8_000, 0.75),  # its one branch cannot press two buttons at once
        ("identity_continuous", "bucket-9", 12_000, 0.78),  # its nine values reach 0.94 at best
        ("identity_hybrid", "hybrid", 11_000, 0.88),
        ("identity_hybrid", "bucket-11", 16_000, 0.86),
        ("identity_hybrid", "multiagent", 8_000, 0.88),
        ("identity_hybrid", "threshold-0.0", 16_000, 0.88),
    ],
)
def test_the_identity_game_is_learned(game, layout, timesteps, wanted, address, tmp_path):
    assert learn(address, tmp_path / "run", game, layout, timesteps) > wanted


def test_plain_autograd_learns_it_too(address, tmp_path):
    assert learn(address, tmp_path / "run", "identity_hybrid", "hybrid", 11_000, autograd=True) > 0.88


@pytest.mark.parametrize("kind", ["bounds", "running"])
def test_sensors_far_from_0_are_learned_scaled(kind, address, tmp_path):
    settings = {"scale_observations": kind, "scale_rewards": True, "max_grad_norm": 0.5, "target_kl": 0.1}
    assert learn(address, tmp_path / "run", "identity_far", "hybrid", 11_000, **settings) > 0.88


def test_a_picture_and_a_number_are_learned_through_convolutions(address, tmp_path):
    settings = {"image_encoder": "simple", "activation": "relu"}
    assert learn(address, tmp_path / "run", "identity_shown", "hybrid", 8_000, **settings) > 0.9


def test_a_map_finds_moles_of_which_independent_axes_have_hit_few(address, tmp_path):
    settings = {"activation": "relu", "learning_rate": 2e-3, "gamma": 0.0, "hidden_sizes": [64]}
    found = learn(address, tmp_path / "map", "moles", "map-16x12", 6_000, **settings)
    assert found > 0.6
    assert learn(address, tmp_path / "bucket", "moles", "bucket-16", 6_000, **settings) < found - 0.3


def test_an_untrained_policy_does_not_reach_it(address, tmp_path):
    assert learn(address, tmp_path / "run", "identity_hybrid", "hybrid", 512, learning_rate=1e-9) < 0.75


def test_two_behaviors_learn_side_by_side_each_with_its_own_policy(address, tmp_path):
    config = load_config(Path(__file__).parents[1] / "configs/ferry/hybrid.yaml", ["total_timesteps=30000"])
    train(config, tmp_path / "run", [address], resume=False)
    scores = evaluate(PlaySpec(tmp_path / "run", address, seed=5, deterministic=True), episodes=32, say=lambda _: None)
    # 60 decisions per episode: a lookout earns 1 each without fail; the helmsman must first reach each gate.
    assert scores["lookout"].means["reward"] > 59
    assert scores["lookout"].episodes == 2 * scores["helmsman"].episodes
    assert scores["helmsman"].means["reward"] > 48
