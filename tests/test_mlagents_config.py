"""Configurations of ML-Agents as ours: every key becomes one of ours or is refused by name."""

from pathlib import Path

import pytest

from joybridge.config.config import load_config
from joybridge.config.errors import ConfigError
from joybridge.config.keys import all_keys
from joybridge.mlagents_player.their_config import BEHAVIOR, RUN, table

pytestmark = pytest.mark.nightly

THEIRS = """
default_settings: {hyperparameters: {num_epoch: 5}}
behaviors:
  hunter:
    trainer_type: ppo
    max_steps: 5.0e5
    summary_freq: 10000
    hyperparameters: {batch_size: 512, buffer_size: 8192, beta: 0.01, learning_rate_schedule: constant}
    network_settings: {normalize: true, hidden_units: 64, num_layers: 3, memory: null}
    reward_signals: {extrinsic: {gamma: 0.995, strength: 1.0}}
environment_parameters: {bird_speed: 0.5}
env_settings: {num_areas: 8, num_envs: 2, seed: 7}
"""


def train_with(text, folder, *overrides, behavior="hunter"):
    path = folder / "their.yaml"
    path.write_text(text)
    return load_config(path, ["game=shooting_birds", *overrides], behavior)


def test_a_configuration_of_ml_agents_becomes_one_of_ours(tmp_path):
    config = train_with(THEIRS, tmp_path)
    assert (config.game, config.arenas, config.seed, config.total_timesteps) == ("shooting_birds", 16, 7, 500_000)
    assert (config.log_interval, config.checkpoint_interval, config.keep_checkpoints) == (10_000, 500_000, 5)
    assert config.parameters == {"bird_speed": 0.5}
    policy = config.policy
    assert (policy.minibatch_size, policy.rollout_steps, policy.epochs, policy.time_horizon) == (512, 512, 5, 64)
    assert (policy.hidden_sizes, policy.shared_body, policy.frame_stack) == ([64, 64, 64], False, 1)
    assert (policy.entropy_coef, policy.learning_rate, policy.gamma, policy.gae_lambda) == (0.01, 3e-4, 0.995, 0.95)
    schedules = (policy.learning_rate_schedule, policy.entropy_coef_schedule, policy.clip_range_schedule)
    assert schedules == ("constant",) * 3 and policy.scale_observations == "running"
    wider = train_with(THEIRS, tmp_path, "arenas=64", "policy.epochs=2")
    assert (wider.arenas, wider.policy.rollout_steps, wider.policy.epochs) == (64, 128, 2)
    assert train_with("behaviors: {hunter: null}", tmp_path).arenas == 75


@pytest.mark.parametrize(
    ("theirs", "size", "length"),
    [("{memory_size: 256, sequence_length: 32}", 128, 32), ("{memory_size: 8}", 4, 64), ("{}", 64, 64)],
)
def test_a_memory_of_ml_agents_becomes_an_lstm_of_half_its_size(theirs, size, length, tmp_path):
    memory = train_with(THEIRS.replace("memory: null", f"memory: {theirs}"), tmp_path).policy.memory
    assert (memory.kind, memory.size, memory.length) == ("lstm", size, length)
    assert train_with(THEIRS, tmp_path).policy.memory.kind == "none"


@pytest.mark.parametrize(
    ("old", "new", "text"),
    [
        ("trainer_type: ppo", "trainer_type: sac", "behaviors.hunter.trainer_type: got 'sac'; Joybridge has PPO only"),
        ("memory: null", "memory: {memory_size: 9}", "memory.memory_size: got 9, expected an even number"),
        ("memory: null", "memory: {size: 8}", "memory.size: got 8; PPO of ML-Agents 1.1.0 has no such key"),
        ("normalize: true", "normalize: maybe", "network_settings.normalize: got 'maybe', expected one of False, True"),
        ("memory: null", "vis_encode_type: match3", "vis_encode_type: got 'match3', expected one of None"),
        ("summary_freq", "sumary_freq", "sumary_freq: got 10000; PPO of ML-Agents 1.1.0 has no such key"),
        ("{extrinsic:", "{curiosity: {strength: 1.0}, extrinsic:", "curiosity.strength: got 1.0; rewards are"),
        ("strength: 1.0", "strength: 0.5", "reward_signals.extrinsic.strength: got 0.5; set policy.reward_weights"),
        ("bird_speed: 0.5", "bird_speed: {curriculum: []}", "bird_speed.curriculum: got .*, expected a list"),
        ("num_areas: 8", "env_path: game.x86_64", "env_settings.env_path: got 'game.x86_64'; use --unity BUILD"),
        ("buffer_size: 8192", "buffer_size: many", "buffer_size: got 'many', expected a whole number"),
        ("hidden_units: 64", "hidden_units: 0", "hidden_units: got 0, expected a whole number from 1 to 1,000,000,000"),
        ("buffer_size: 8192", "buffer_size: .inf", "buffer_size: got inf, expected a whole number from 1 to"),
        ("num_layers: 3", "num_layers: 5000", "num_layers: got 5000, expected at most 1000"),
        ("{hyperparameters: {num_epoch: 5}}", "3", "default_settings: got 3, expected a section with keys"),
        ("{bird_speed: 0.5}", "[1]", r"environment_parameters: got \[1\], expected a section with keys"),
        ("batch_size: 512", "batch_size: 0", "policy.minibatch_size: got 0"),
        (
            "default_settings: {hyperparameters: {num_epoch: 5}}\nbehaviors:\n  hunter:",
            "behaviors:\n  bird:",
            "--behavior hunter: the file has no such behavior under `behaviors`; it has bird",
        ),
    ],
)
def test_a_key_of_ml_agents_without_one_of_ours_is_refused_by_name(old, new, text, tmp_path):
    assert old in THEIRS
    with pytest.raises(ConfigError, match=text):
        train_with(THEIRS.replace(old, new), tmp_path)


@pytest.mark.parametrize(
    ("text", "where"), [("behaviors: hunter", "behaviors: got 'hunter'"), ("behaviors: {hunter: 5}", "hunter: got 5")]
)
def test_what_is_no_section_is_named(text, where, tmp_path):
    with pytest.raises(ConfigError, match=f"{where}, expected a section with keys"):
        train_with(text, tmp_path)


def test_every_key_of_ml_agents_is_documented_and_leads_to_a_key_of_ours():
    page = (Path(__file__).parents[1] / "docs/from-ml-agents.md").read_text()
    assert "\n".join(table()) in page
    keys = {key.name.removeprefix("policy.") for key in all_keys()}
    assert {entry.ours.removeprefix("policy.") for entry in (BEHAVIOR | RUN).values() if entry.ours} <= keys
