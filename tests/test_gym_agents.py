"""PettingZoo environments and games of several agents, through gRPC at a real server process."""

import warnings

import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.spaces import Box, MultiDiscrete
from gymnasium.utils.env_checker import data_equivalence

from joybridge.client.client import Session
from joybridge.config.errors import ConfigError
from joybridge.contract.codec import ActArrays
from joybridge.games import BUILT_IN
from joybridge.gym import BridgeEnv, BridgeParallelEnv, BridgeVectorEnv, sample_allowed

with warnings.catch_warnings(action="ignore", category=DeprecationWarning):  # of games that it imports of its own
    from pettingzoo.test import parallel_api_test, parallel_seed_test


def test_an_agents_forbidden_choice_names_the_agent_and_can_be_corrected(make):
    env = make(BridgeParallelEnv, "turns")
    env.reset()
    with pytest.raises(ValueError, match=r"actions\['player_0'\]: branch 'card' got 'ace' in lane 0, which its mask"):
        env.step({"player_0": [0]})
    assert env.step({"player_0": [1]})[4]["player_1"]["deciding"] is True


def test_two_policies_act_together_on_one_device(gym_simulator, make):
    channels = {"axes": {"hit": 0, "miss": 0, "dry_shot": 0, "reload": 0, "aimed_hit": 1, "aimed_miss": 1}}
    env = make(BridgeParallelEnv, "shooting_birds", layout="multiagent", reward_weights=channels, seed=9)
    assert env.possible_agents == ["axes", "buttons"]
    assert env.action_space("axes") == Box(-1, 1, (2,)) and env.action_space("buttons") == MultiDiscrete([3])
    env.reset()
    with Session(gym_simulator, "shooting_birds", arenas=1, seed=9) as session:
        names = [channel.name for channel in session.spec.behaviors[0].channels]
        for decision in range(200):
            moves = {"axes": np.array([np.sin(decision), 0.5], np.float32), "buttons": np.array([decision % 3])}
            observations, rewards, *_ = env.step(moves)
            buttons = np.array([[decision % 3 == 0, decision % 3 == 1]], np.int32)
            (step,) = session.step([ActArrays(moves["axes"][None], buttons)])
            paid = dict(zip(names, step.rewards[0].tolist(), strict=True))
            assert rewards["buttons"] == sum(paid[name] for name in ("hit", "miss", "dry_shot", "reload"))
            assert rewards["axes"] == paid["aimed_hit"] + paid["aimed_miss"]
            for observation in observations.values():
                assert np.array_equal(observation[-44:], np.concatenate([o[0].ravel() for o in step.observations]))
        assert env.agents == ["axes", "buttons"]


def test_each_agent_of_each_behavior_has_its_own_actions_and_rewards(make):
    env = make(
        BridgeParallelEnv,
        "chase",
        layout="hybrid",
        frame_stack=2,
        render_mode="rgb_array",
        reward_weights={"runner_1": {"fled": 10}},
    )
    assert env.possible_agents == ["hunter", "runner_0", "runner_1"]
    begun, infos = env.reset(seed=1)
    assert {agent: len(observation) for agent, observation in begun.items()} == {
        "hunter": 4,
        "runner_0": 2,
        "runner_1": 2,
    }
    choices = {agent: len(info["action_mask"]) for agent, info in infos.items()}
    assert choices == {"hunter": 0, "runner_0": 5, "runner_1": 5} and not env.render().any()
    moves = {"hunter": [0.5], "runner_0": [2, 1], "runner_1": [0, 0]}
    for count in range(1, 21):
        observations, rewards, terminated, truncated, infos = env.step(moves)
        assert rewards == {"hunter": -5.0 + 0.5 * count, "runner_0": 1.0 - 1.0, "runner_1": -10.0}
        assert observations["runner_0"][1] == pytest.approx(begun["runner_0"][1] + count, abs=1e-5)
        assert set(terminated.values()) == {count == 20} and not any(truncated.values())
        assert (env.render() == count % 20).all()
    assert env.agents == [] and "place" not in infos["hunter"]
    assert infos["runner_1"]["place"] == observations["runner_1"][1]
    with pytest.raises(ResetNeeded):
        env.step({})
    again = env.reset()[0]
    assert env.agents == env.possible_agents and not np.array_equal(again["runner_0"], begun["runner_0"])


def test_agents_take_turns(make):
    env = make(BridgeParallelEnv, "turns", layout="hybrid")
    _, infos = env.reset()
    while env.agents:
        (agent,) = (agent for agent in env.agents if infos[agent]["deciding"])
        space = env.action_space(agent)
        move = sample_allowed(space, infos[agent]["action_mask"])
        with pytest.raises(ValueError, match=f"actions has none of agent '{agent}'"):
            env.step({})
        *_, infos = env.step({agent: move})  # those that wait may be left out
    assert infos.keys() == {"player_0", "player_1"}


PARALLEL = [
    *((game, "hybrid") for game in [*BUILT_IN, "chase"]),
    ("shooting_birds", "multiagent"),
    ("chase", "multiagent"),
]


@pytest.mark.parametrize(("game", "layout"), PARALLEL)
@pytest.mark.promise("E1")
def test_pettingzoos_tests_pass(make, game, layout):
    settings = {"layout": layout, "forbidden": "first_allowed"}  # PettingZoo's tests look for masks in observations
    parallel_api_test(make(BridgeParallelEnv, game, **settings), num_cycles=100)
    parallel_seed_test(lambda: make(BridgeParallelEnv, game, **settings), num_cycles=60)


def test_the_same_seed_plays_the_same_game(make):
    envs = [make(BridgeParallelEnv, "beastly_rivals", layout="multiagent") for _ in range(2)]
    returned = [env.reset(seed=8) for env in envs]
    for _ in range(300):  # several episodes
        assert data_equivalence(*returned, exact=True)
        moves = {agent: envs[0].action_space(agent).sample() for agent in envs[0].agents}
        returned = [env.step(moves) if moves else env.reset() for env in envs]


def test_an_agents_wrong_action_names_the_agent(make):
    env = make(BridgeParallelEnv, "chase", layout="hybrid")
    env.reset()
    with pytest.raises(ValueError, match=r"actions\['runner_1'\]: 3 at \[0, 0\], expected 0..2"):
        env.step({"hunter": [0.0], "runner_0": [0, 0], "runner_1": [3, 0]})


def test_others_hold_all_seats_but_the_first_of_each_arena(make):
    env = make(BridgeEnv, "noughts", others=["script:perfect"])
    returns: list[float] = []
    _, info = env.reset(seed=3)
    total = 0.0
    for _ in range(120):
        action = sample_allowed(env.action_space, info["action_mask"])
        _, reward, terminated, _, info = env.step(action)
        total += reward
        if terminated:
            returns.append(total)
            total, (_, info) = 0.0, env.reset()
    assert len(returns) > 10 and max(returns) <= 0 and min(returns) == -1  # nobody beats it
    short = {"players": "3", "lives": "0", "pauses": "short", "locomotion": "axes"}
    scripts = ["script:flee", "script:patient"]
    envs = make(BridgeVectorEnv, "beastly_rivals_full", 3, others=scripts, options=short)
    observations, infos = envs.reset(seed=1)
    assert envs.num_envs == 3 and len(observations) == 3 and infos["deciding"].shape == (3,)
    for _ in range(50):
        envs.step(envs.action_space.sample())
    with pytest.raises(ConfigError, match="archer has one agent, which plays alone"):
        make(BridgeEnv, "archer", others=["script:perfect"])
    with pytest.raises(ConfigError, match="noughts has no such script"):
        make(BridgeEnv, "noughts", others=["script:fool"])
