"""Other learners play through `joybridge.gym`: Stable-Baselines3, sb3-contrib and the loop of examples/ppo.py."""

import importlib.util
import sys
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from gymnasium.error import ResetNeeded
from stable_baselines3 import PPO
from stable_baselines3.common.env_checker import check_env
from stable_baselines3.common.torch_layers import CombinedExtractor, NatureCNN
from stable_baselines3.common.vec_env import VecExtractDictObs, VecFrameStack, VecMonitor

from joybridge.client.launch import simulator_process
from joybridge.config.errors import ConfigError
from joybridge.contract.spec import SpecError
from joybridge.games import BUILT_IN
from joybridge.gym import BridgeEnv, BridgeVectorEnv
from joybridge.gym.sb3 import BridgeVecEnv

with warnings.catch_warnings(action="ignore", category=DeprecationWarning):
    from sb3_contrib import MaskablePPO

SUITABLE = sorted(set(BUILT_IN) - {"beastly_rivals_full", "ferry", "noughts"})  # one agent
SHORT: dict[str, Any] = {"n_steps": 8, "batch_size": 32, "n_epochs": 1, "device": "cpu", "seed": 1}


@pytest.fixture(scope="module")
def simulator():
    with simulator_process(["tests.support.gym_games:Brief", "tests.support.gym_games:Gallery"]) as address:
        yield address


@pytest.fixture
def make(simulator):
    """Make environments at the shared simulator and close them."""
    made = []

    def make(*arguments, kind=BridgeVecEnv, **settings):
        made.append(kind(*arguments, simulator=simulator, **settings))
        return made[-1]

    yield make
    for environment in made:
        environment.close()


def test_the_infos_of_an_end_hold_the_final_observation_and_the_metrics(make):
    envs = make("brief", 4, kind=BridgeVectorEnv, layout="bucket-11")
    adapted = make("brief", 4, layout="bucket-11")
    envs.action_space.seed(3)
    adapted.seed(6)
    assert np.array_equal(adapted.reset(), envs.reset(seed=6)[0])
    for _ in range(6):
        actions = envs.action_space.sample()
        observations, rewards, terminated, truncated, infos = envs.step(actions)
        returned: Any = adapted.step(actions)
        for array, wanted in zip(returned, (observations, rewards, terminated | truncated), strict=False):
            assert np.array_equal(array, np.asarray(wanted, array.dtype))
        for lane, info in enumerate(returned[3]):
            if terminated[lane] or truncated[lane]:
                assert np.array_equal(info["terminal_observation"], infos["final_obs"][lane])
                assert info["TimeLimit.truncated"] == truncated[lane]
                assert {name: info[name] for name in ("length", "presses")} == {
                    name: infos["final_info"][name][lane] for name in ("length", "presses")
                }
            else:
                assert info == {}


def test_options_that_are_set_count_from_the_next_reset_on(make):
    envs = make("archer", 2, layout="bucket-3")
    envs.set_options({"parameters": {"nonsense": 1.0}})
    with pytest.raises(SpecError, match="unknown parameter 'nonsense'"):
        envs.reset()
    envs.set_options()
    envs.reset()


@pytest.mark.parametrize("game", SUITABLE)
def test_ppo_plays_every_game_with_one_agent(make, game):
    envs = VecMonitor(make(game, 4, layout="bucket-5", forbidden="first_allowed"))
    model = PPO("MlpPolicy", envs, **SHORT)
    before = model.policy.action_net.state_dict()["weight"].clone()
    model.learn(64)
    assert not torch.equal(model.policy.action_net.state_dict()["weight"], before)


@pytest.mark.parametrize("game", ["archer", "noughts"])
def test_maskable_ppo_never_makes_a_forbidden_choice(make, game):
    with pytest.raises(ResetNeeded, match="call reset first"):
        make(game, 1, layout="bucket-5").action_masks()
    envs = make(game, 4, layout="bucket-5")  # in which a forbidden choice is an error
    assert envs.has_attr("action_masks") and envs.action_masks is not None
    MaskablePPO("MlpPolicy", envs, **SHORT).learn(96)
    masks = envs.env_method("action_masks")
    assert np.array_equal(np.stack(masks), envs.action_masks()) and not envs.action_masks().all()


def test_sensors_in_their_shapes_feed_a_policy_of_several_inputs(make):
    envs = make("gallery", 2, flatten=False, frame_stack=1)
    PPO("MultiInputPolicy", envs, **(SHORT | {"batch_size": 16})).learn(16)


SCREEN: dict[str, Any] = {
    "flatten": False,
    "frame_stack": 1,
    "layout": "bucket-3",
    "forbidden": "first_allowed",
    "options": {"observation": "screen"},
}


def test_a_policy_of_stable_baselines3_sees_the_screen_with_convolutions(make):
    envs = make("shooting_birds", 2, **SCREEN)
    space = envs.observation_space["screen"]
    assert (space.dtype, space.shape, space.low.max(), space.high.min()) == (np.uint8, (40, 64, 1), 0, 255)
    several = PPO("MultiInputPolicy", envs, **(SHORT | {"batch_size": 16})).learn(16)
    assert isinstance(several.policy.features_extractor, CombinedExtractor)
    assert isinstance(dict(several.policy.features_extractor.extractors.named_children())["screen"], NatureCNN)
    frames = VecFrameStack(VecExtractDictObs(envs, "screen"), 3)
    single = PPO("CnnPolicy", frames, **(SHORT | {"batch_size": 16})).learn(16)
    assert isinstance(single.policy.features_extractor, NatureCNN)
    assert single.policy.observation_space.shape == (3, 40, 64)


def test_images_are_not_flattened(make):
    settings = SCREEN | {"flatten": True}
    with pytest.raises(ConfigError, match=r"hunter: screen of hunter would be flattened.*pass flatten=False"):
        make("shooting_birds", 2, **settings)


def test_one_arena_passes_the_checks_of_stable_baselines3(make):
    check_env(make("orchard", kind=BridgeEnv))


def test_actions_of_both_kinds_are_refused_with_the_next_move(make):
    with pytest.raises(ValueError, match=r"no actions that are continuous and discrete at once; choose .*bucket-5"):
        make("archer", 2)


def test_pictures_are_drawn_once_they_are_asked_for(make):
    envs = make("orchard", 2, render_mode="rgb_array")
    envs.reset()
    assert not envs.render().any()
    envs.step(np.zeros((2, 2), int))
    assert envs.render().any()


def test_without_stable_baselines3_a_sentence_says_how_to_install_it(monkeypatch):
    monkeypatch.delitem(sys.modules, "joybridge.gym.sb3")
    monkeypatch.setitem(sys.modules, "stable_baselines3.common.vec_env", None)
    with pytest.raises(ModuleNotFoundError, match=r"joybridge\.gym\.sb3 needs .*`pip install stable-baselines3`"):
        importlib.import_module("joybridge.gym.sb3")


@pytest.fixture(scope="module")
def ppo():
    """Return the module of the example."""
    path = Path(__file__).parents[1] / "trainer/examples/ppo.py"
    spec = importlib.util.spec_from_file_location("ppo", path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("game", sorted(set(BUILT_IN) - {"ferry"}))  # one behavior
def test_the_loop_in_plain_pytorch_plays_every_game_of_one_behavior(make, ppo, monkeypatch, game):
    monkeypatch.setattr(ppo, "STEPS", 12)
    envs = make(game, 4, kind=BridgeVectorEnv, frame_stack=1)  # in which a forbidden choice is an error
    played = 0
    step = envs.step

    def counted(actions):
        nonlocal played
        played += 1
        return step(actions)

    monkeypatch.setattr(envs, "step", counted)
    assert len(list(ppo.train(envs, 2 * 12 * envs.num_envs))) == 2 and played == 2 * 12
