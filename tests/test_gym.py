"""Gymnasium environments of one arena and of many, through gRPC at a real server process."""

from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.spaces import Box, Dict, MultiDiscrete
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space
from gymnasium.wrappers.vector import DictInfoToList, RecordEpisodeStatistics

from joybridge.client.client import Session
from joybridge.config.errors import ConfigError
from joybridge.contract.codec import ActArrays
from joybridge.gym import BridgeEnv, BridgeVectorEnv, sample_allowed
from joybridge.layouts import CLIP, make_layouts

CHECKED = ["joybridge/ShootingBirds-v0", "joybridge/BeastlyRivals-v0", "joybridge/Orchard-v0"]
LAYOUTS = ["bucket-11", "hybrid", "threshold-0.5"]


def flat(observations):
    return np.concatenate([o.reshape(len(o), -1) for o in observations], axis=1)


def raw_actions(space, actions):
    """Return what a layout is given for the actions of an environment: continuous and discrete."""
    if not isinstance(space, Dict):
        actions = {"discrete" if isinstance(space, MultiDiscrete) else "continuous": actions}
    none = np.zeros((len(next(iter(actions.values()))), 0), int)
    return CLIP * actions.get("continuous", none).astype(float), actions.get("discrete", none)


# ------------------------------------------------------------------------------------------ many arenas


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("game", ["shooting_birds", "beastly_rivals", "brief"])
def test_a_vector_environment_returns_what_its_session_receives(gym_simulator, make, game, layout):
    envs = make(BridgeVectorEnv, game, 3, layout=layout, frame_stack=2, seed=7)
    with Session(gym_simulator, game, arenas=3, seed=7) as session:
        (behavior,) = session.spec.behaviors
        (mapping,) = make_layouts(layout, behavior.device).values()
        weights = np.array([channel.default_weight for channel in behavior.channels], np.float32)
        observations, _ = envs.reset()
        frames = flat(session.steps[0].observations)
        stacked = np.concatenate([np.zeros_like(frames), frames], axis=1)
        assert np.array_equal(observations, stacked) and observations.dtype == np.float32
        for _ in range(30):
            actions = envs.action_space.sample()
            act = ActArrays(
                np.zeros((3, len(behavior.device.axes)), np.float32),
                np.zeros((3, len(behavior.device.branches)), np.int32),
            )
            continuous, discrete = raw_actions(envs.single_action_space, actions)
            mapping.write(continuous, discrete, act)
            (step,) = session.step([act])
            observations, rewards, terminated, truncated, _ = envs.step(actions)
            stacked = np.concatenate([stacked[:, frames.shape[1] :], flat(step.observations)], axis=1)
            stacked[step.ended, : frames.shape[1]] = 0.0
            assert np.array_equal(observations, stacked)
            assert np.array_equal(rewards, step.rewards @ weights)
            assert np.array_equal(terminated, step.terminated) and np.array_equal(truncated, step.truncated)


@pytest.mark.parametrize("game", ["shooting_birds", "beastly_rivals"])
@pytest.mark.parametrize("layout", LAYOUTS)
def test_returned_values_have_the_shapes_and_types_of_gymnasium(make, game, layout):
    envs = make(BridgeVectorEnv, game, 4, layout=layout)
    assert envs.num_envs == 4 and envs.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP
    assert envs.observation_space == batch_space(envs.single_observation_space, 4)
    assert envs.action_space == batch_space(envs.single_action_space, 4)
    returned = [envs.reset(seed=1)[0]]
    assert envs.np_random_seed == 1
    for _ in range(50):
        observations, rewards, terminated, truncated, infos = envs.step(envs.action_space.sample())
        assert observations in envs.observation_space
        assert [array.shape for array in (rewards, terminated, truncated)] == [(4,)] * 3
        assert (rewards.dtype, terminated.dtype, truncated.dtype) == (np.float64, bool, bool)
        assert isinstance(infos, dict)
        assert not any(np.shares_memory(observations, earlier) for earlier in returned)
        observations[:] = np.nan  # a user's arrays are the user's
        returned.append(observations)
    assert terminated.flags.writeable and truncated.flags.writeable


def test_spaces_follow_layout_and_spec(make):
    spaces = {layout: make(BridgeVectorEnv, "brief", 2, layout=layout).single_action_space for layout in LAYOUTS}
    assert spaces["bucket-11"] == MultiDiscrete([11, 3, 2])
    assert spaces["threshold-0.5"] == Box(-1, 1, (3,))
    assert spaces["hybrid"] == Dict(continuous=Box(-1, 1, (1,)), discrete=MultiDiscrete([2, 3]))
    space = make(BridgeVectorEnv, "brief", 2, frame_stack=3).single_observation_space
    assert space.low.tolist() == [0.0, -1.0, -1.0] * 2 + [10.0, -1.0, -1.0]  # only earlier frames may be zero
    assert space.high.tolist() == [20.0, np.inf, np.inf] * 3
    assert make(BridgeVectorEnv, "brief", 2, frame_stack=1).single_observation_space.low[0] == 10.0


def test_continuous_actions_span_the_axis_and_are_clipped(make):
    envs = make(BridgeVectorEnv, "brief", 5, reward_weights={"press": 0.0})
    envs.reset()
    lever = np.array([[-1.0], [-0.5], [0.0], [1.0], [7.0]])  # of an axis that reaches from -2 to 4
    rewards = envs.step({"continuous": lever, "discrete": np.zeros((5, 2), int)})[1]
    assert rewards.tolist() == [-2.0, -0.5, 1.0, 4.0, 4.0]


def test_reward_weights_replace_the_defaults(make):
    envs = make(BridgeVectorEnv, "brief", 2, layout="bucket-11", reward_weights={"press": -3.0, "gear": 0.25})
    envs.reset()
    rewards = envs.step(np.array([[10, 2, 0], [0, 1, 1]]))[1]  # lever 4, gear 2, pressed; lever -2, gear 1, nothing
    assert rewards.tolist() == [4.0 - 3.0 + 0.5, -2.0 + 0.25]


def test_an_episode_that_ends_is_followed_by_the_next_in_the_same_step(make):
    envs = make(BridgeVectorEnv, "brief", 6, frame_stack=3, seed=2)
    observations, _ = envs.reset()
    press = {"continuous": np.zeros((6, 1)), "discrete": np.tile([1, 0], (6, 1))}
    ages = np.zeros(6, int)
    seen = set()
    for _ in range(12):
        before = observations
        observations, _, terminated, truncated, infos = envs.step(press)
        ages += 1
        ended = terminated | truncated
        assert ("final_obs" in infos) == ("final_info" in infos) == ended.any()
        if ended.any():
            assert np.array_equal(infos["_final_obs"], ended) and np.array_equal(infos["_final_info"], ended)
            for name in ("length", "presses"):
                assert np.array_equal(infos["final_info"][name], np.where(ended, ages, 0))
                assert np.array_equal(infos["final_info"][f"_{name}"], ended)
        for lane in range(6):
            if ended[lane]:
                final = infos["final_obs"][lane]
                assert final in envs.single_observation_space
                assert np.array_equal(final[:6], before[lane, 3:]) and final[6] == 10 + ages[lane]
                assert observations[lane, 6] == 10 and not observations[lane, :6].any()
                assert terminated[lane] == bool(ages[lane] % 2)
                seen.add(int(ages[lane]))
                ages[lane] = 0
            else:
                assert np.array_equal(observations[lane, :6], before[lane, 3:])
                assert not ended.any() or infos["final_obs"][lane] is None
    assert seen == {1, 2, 3, 4}


def test_wrappers_of_gymnasium_work(make):
    envs = RecordEpisodeStatistics(make(BridgeVectorEnv, "brief", 4))
    lists = DictInfoToList(envs)
    lists.reset(seed=3)
    for _ in range(6):
        *_, terminated, truncated, infos = lists.step(lists.action_space.sample())
        for info, ended in zip(infos, terminated | truncated, strict=True):
            assert ended == ("final_obs" in info) == ("episode" in info)
            assert not ended or info["final_info"]["length"] == info["episode"]["l"]
    assert len(envs.length_queue) > 4


def test_the_same_seed_gives_the_same_episodes(make):
    envs, others = (make(BridgeVectorEnv, "shooting_birds", 2, seed=seed) for seed in (4, 5))
    first = envs.reset()[0]
    other = others.reset()[0]
    assert not np.array_equal(first, other)
    assert np.array_equal(others.reset(seed=4)[0], first)
    again = envs.reset()[0]
    assert not np.array_equal(again, first)  # new episodes: the streams went on
    assert np.array_equal(others.reset()[0], again)
    assert np.array_equal(envs.reset(seed=np.int64(5))[0], other)


@pytest.mark.parametrize("seed", [[1, 2], -1, 2**64, 1.5])
def test_an_invalid_seed_raises_and_changes_nothing(make, seed):
    envs = make(BridgeVectorEnv, "brief", 2)
    envs.reset()
    with pytest.raises(ValueError, match=r"seed is .*, expected one int of 0\.\.2\^64-1"):
        envs.reset(seed=seed)
    envs.step(envs.action_space.sample())  # and the environment goes on


def test_parameters_are_drawn_at_each_episode(make):
    shift = {"choice": [1.0, 3.0]}
    envs = make(BridgeVectorEnv, "brief", 16, frame_stack=1, parameters={"shift": shift})
    first = envs.reset()[0][:, 0].tolist()
    assert set(first) == {11.0, 13.0}
    assert envs.reset()[0][:, 0].tolist() != first and envs.reset(seed=0)[0][:, 0].tolist() == first
    with pytest.raises(ConfigError, match=r"reset: parameters.shift is .*, expected a number; give a distribution"):
        envs.reset(options={"parameters": {"shift": shift}})


@pytest.mark.parametrize(
    "value", [{"normal": [0, 1]}, {"uniform": [1]}, {}, {"choice": "ab"}, {"choice": ["2"]}, "2", None, True, np.inf]
)
def test_what_is_no_value_of_a_parameter_is_named_before_a_simulator_is_asked(value):
    with pytest.raises(ConfigError, match=r"parameters.shift is .*, expected a number, \{'uniform': \[LOW, HIGH\]\}"):
        BridgeVectorEnv("brief", 1, simulator="127.0.0.1:1", parameters={"shift": value})


def test_parameters_change_at_a_reset(make):
    envs = make(BridgeVectorEnv, "brief", 2, frame_stack=1, parameters={"shift": 2.0})
    assert envs.reset()[0][:, 0].tolist() == [12.0, 12.0]
    assert envs.reset(options={"parameters": {"shift": 4}})[0][:, 0].tolist() == [14.0, 14.0]
    assert envs.reset(seed=1, options={})[0][:, 0].tolist() == [14.0, 14.0]
    with pytest.raises(ValueError, match=r"brief: parameter 'shift' got 9, expected 0\.\.5"):
        envs.reset(options={"parameters": {"shift": 9.0}})
    with pytest.raises(ValueError, match="unknown option 'reset_mask', expected parameters"):
        envs.reset(options={"reset_mask": np.ones(2, bool)})


def test_arenas_are_drawn_from_the_first_render_until_the_next_reset(make, monkeypatch):
    drawn: list[Any] = []
    monkeypatch.setattr(Session, "step_and_draw", count_draws(drawn))
    envs = make(BridgeVectorEnv, "brief", 3, render_mode="rgb_array", seed=1)
    assert envs.metadata["render_fps"] == pytest.approx(10.0)
    for episodes in range(2):
        envs.reset()
        envs.step(envs.action_space.sample())
        assert drawn == [0, 1, 2] * 2 * episodes  # nobody has asked for a picture since the reset
        pictures = envs.render()
        assert [picture.shape for picture in pictures] == [(4, 6, 3)] * 3 and not np.any(pictures)
        for _ in range(2):
            observations = envs.step(envs.action_space.sample())[0]
            pictures = envs.render()
            assert isinstance(pictures, tuple)
            assert [int(picture[0, 0, 0]) for picture in pictures] == observations[:, 6].tolist()
    assert drawn == [0, 1, 2] * 4


def count_draws(drawn):
    step_and_draw = Session.step_and_draw

    def counted(session, acts, draw):
        drawn.extend(draw)
        return step_and_draw(session, acts, draw)

    return counted


def test_infos_hold_the_masks_and_which_lanes_decide(make):
    envs = make(BridgeVectorEnv, "turns", 2, frame_stack=2)  # lanes: two agents of each arena
    observations, infos = envs.reset()
    assert envs.num_envs == 4 and infos["deciding"].tolist() == [True, False] * 2 and infos["_deciding"].all()
    for count in range(1, 9):
        mask = infos["action_mask"]
        deciding = infos["deciding"]
        assert mask.shape == (4, 3) and mask.dtype == bool and mask[~deciding].all() and not mask[deciding].all()
        cards = np.where(deciding, mask.argmax(axis=1), 99)  # actions of lanes that wait may be anything
        observations, rewards, *_, infos = envs.step(cards[:, None])
        assert np.array_equal(infos["deciding"], ~deciding)
        assert not rewards[deciding].any()
        assert observations[infos["deciding"], 1].tolist() == [count] * 2
    (last,) = {tuple(pair) for pair in observations[[0, 2]].tolist()}
    assert last == (6.0, 8.0)  # frames in which the lane waited were not pushed
    *_, terminated, _, infos = envs.step(np.where(infos["deciding"], infos["action_mask"].argmax(axis=1), 0)[:, None])
    assert terminated.all() and infos["final_info"] == {}


@pytest.mark.parametrize("game", ["archer", "marble"])
@pytest.mark.parametrize("layout", LAYOUTS)
def test_a_mask_has_one_form_and_sampling_obeys_it(make, game, layout):
    env = make(BridgeEnv, game, layout=layout, seed=2)
    envs = make(BridgeVectorEnv, game, 3, layout=layout, seed=2)
    (_, info), (_, infos) = env.reset(), envs.reset()
    forbidden = 0
    for _ in range(130):  # more than an episode
        mask, masks = info["action_mask"], infos["action_mask"]
        assert mask.dtype == masks.dtype == bool and masks.shape == (3, len(mask)) and infos["_action_mask"].all()
        assert info["deciding"] is True and infos["deciding"].tolist() == [True] * 3
        forbidden += int((~mask).sum())
        action = sample_allowed(env.action_space, mask)
        actions = sample_allowed(envs.action_space, masks)
        assert action in env.action_space and actions in envs.action_space
        *_, terminated, truncated, info = env.step(action)
        *_, infos = envs.step(actions)
        if terminated or truncated:
            _, info = env.reset()
    assert (forbidden > 0) == (game == "archer" and layout != "threshold-0.5")


def test_sampling_is_uniform_over_what_is_allowed_and_repeats_with_the_seed_of_the_space():
    mask = np.tile([True, False, True, False, True, True, True], (1000, 1))
    first, again = (sample_allowed(batch_space(MultiDiscrete([3, 4], seed=1), 1000), mask) for _ in range(2))
    for column, allowed in zip(first.T, ([0, 2], [1, 2, 3]), strict=True):
        choices, counts = np.unique(column, return_counts=True)
        assert choices.tolist() == allowed and counts.min() > 0.85 * 1000 / len(allowed)
    assert np.array_equal(first, again)


@pytest.mark.parametrize("layout", ["bucket-11", "hybrid"])
def test_a_forbidden_choice_is_an_error_that_leaves_the_environment_usable(make, layout):
    envs = make(BridgeVectorEnv, "archer", 2, layout=layout, seed=2)
    other = make(BridgeVectorEnv, "archer", 2, layout=layout, seed=2)
    (observations, infos), (others, _) = envs.reset(), other.reset()
    loose = sample_allowed(envs.action_space, infos["action_mask"])
    allowed = {kind: part.copy() for kind, part in loose.items()} if layout == "hybrid" else loose.copy()
    (loose["discrete"] if layout == "hybrid" else loose)[1, -1] = 2
    with pytest.raises(
        ValueError, match=r"branch 'string' got 'loose' in lane 1, which its mask forbids .*action_mask"
    ):
        envs.step(loose)
    assert np.array_equal(envs.step(allowed)[0], other.step(allowed)[0])
    assert np.array_equal(observations, others)


def test_a_forbidden_choice_may_be_replaced_by_the_first_allowed_one(make):
    envs, others = (make(BridgeVectorEnv, "turns", 2, forbidden=way) for way in ("first_allowed", "error"))
    (_, infos), _ = envs.reset(), others.reset()
    replaced = 0
    for _ in range(20):  # more than two episodes
        cards = envs.action_space.sample()
        allowed = infos["action_mask"][np.arange(4), cards[:, 0]]
        replaced += int((~allowed).sum())
        instead = np.where(allowed, cards[:, 0], infos["action_mask"].argmax(axis=1))
        *played, infos = envs.step(cards)
        for mine, wanted in zip(played, others.step(instead[:, None])[:4], strict=True):
            assert np.array_equal(mine, wanted)
    assert replaced > 0


@pytest.mark.parametrize("frame_stack", [1, 3])
def test_sensors_keep_their_shapes_on_request(make, frame_stack):
    flat, shaped = (
        make(BridgeVectorEnv, "brief", 4, frame_stack=frame_stack, flatten=flatten, seed=3) for flatten in (True, False)
    )
    frames = () if frame_stack == 1 else (frame_stack,)
    spaces = shaped.single_observation_space
    assert {name: space.shape for name, space in spaces.items()} == {"clock": (*frames, 1), "noise": (*frames, 2, 1)}
    observations, arrays = shaped.reset()[0], flat.reset()[0]
    ended = 0
    for _ in range(12):
        assert observations in shaped.observation_space
        parts = [observations[name].reshape(4, frame_stack, -1) for name in ("clock", "noise")]
        assert np.array_equal(np.concatenate(parts, axis=2).reshape(4, -1), arrays)
        actions = flat.action_space.sample()
        observations, *_, infos = shaped.step(actions)
        arrays, *_, expected = flat.step(actions)
        for lane in np.flatnonzero(infos.get("_final_obs", [])):
            final = infos["final_obs"][lane]
            assert final in spaces
            parts = [final[name].reshape(frame_stack, -1) for name in ("clock", "noise")]
            assert np.array_equal(np.concatenate(parts, axis=1).ravel(), expected["final_obs"][lane])
            ended += 1
    assert ended > 4


def test_sensors_keep_their_dtypes_on_request(make):
    env = make(BridgeEnv, "gallery", flatten=False, frame_stack=2)
    spaces = env.observation_space
    assert spaces["image"] == Box(0, 255, (2, 36, 40, 1), np.uint8)
    assert spaces["count"] == Box(np.array([[-7], [-7]]), np.array([[2**31 - 1]] * 2), dtype=np.int32)
    assert spaces["lamp"] == Box(0, 1, (2, 2), np.bool_)
    check_env(env, skip_render_check=True)
    observation = env.reset(seed=1)[0]
    assert {name: part.dtype for name, part in observation.items()} == {
        "image": np.uint8,
        "count": np.int32,
        "lamp": bool,
    }
    assert observation["image"][1].max() == 255 and not observation["image"][0].any()
    assert observation["count"][1] == 2**24 + 1  # which float32 does not have


# ------------------------------------------------------------------------------------------- one arena


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("name", CHECKED)
@pytest.mark.promise("E1")
def test_check_env_passes(gym_simulator, name, layout):
    env = gymnasium.make(name, layout=layout, simulator=gym_simulator)
    try:
        check_env(env.unwrapped)
    finally:
        env.close()


def test_one_arena_plays_the_same_as_in_a_vector_environment(make):
    env = make(BridgeEnv, "brief", layout="bucket-11", seed=3)
    envs = make(BridgeVectorEnv, "brief", 1, layout="bucket-11", seed=3)
    observation = env.reset()[0]
    assert np.array_equal(envs.reset()[0][0], observation)
    for _ in range(20):
        action = env.action_space.sample()
        observation, reward, terminated, truncated, info = env.step(action)
        others = envs.step(action[None])
        assert (reward, terminated, truncated) == tuple(values[0] for values in others[1:4])
        if terminated or truncated:
            assert np.array_equal(observation, others[4]["final_obs"][0])
            metrics = {name: others[4]["final_info"][name][0] for name in ("length", "presses")}
            assert {name: info[name] for name in info if name not in ("action_mask", "deciding")} == metrics
            with pytest.raises(ResetNeeded, match="call reset"):
                env.step(action)
            observation = env.reset()[0]  # the next episode has begun already
        assert np.array_equal(observation, others[0][0])


def test_one_arenas_picture(make):
    env = make(BridgeEnv, "brief", render_mode="rgb_array")
    env.reset(seed=5)
    assert not env.render().any()
    env.step(env.action_space.sample())
    assert env.render().shape == (4, 6, 3) and env.render().any()
    assert make(BridgeEnv, "brief").render() is None
