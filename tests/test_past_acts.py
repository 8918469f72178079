"""`remember_acts`: a policy sees its last actions and what they earned, the same wherever it learns or plays."""

from itertools import islice

import numpy as np
import pytest

from joybridge.cli import main
from joybridge.client.client import describe
from joybridge.config.config import Config, HandConfig
from joybridge.config.policy_config import PolicyConfig
from joybridge.contract.codec import ActArrays, StepArrays
from joybridge.contract.tensors import TensorError
from joybridge.demonstrations.cloning import targets
from joybridge.demonstrations.files import load_demonstration
from joybridge.play.agent import load
from joybridge.play.playing import PlaySpec, open_play
from joybridge.policy.actor import make_actors
from joybridge.policy.past_acts import PastActs
from joybridge.run.train import train
from joybridge.simulator import axis, behavior, branch, sensor
from joybridge.simulator.catalog import load_games
from tests.support.demonstrated import record
from tests.support.games import PLACES
from tests.test_policy import full_agents

COUNT = 3
DEFAULTS = {"size": "small", "masks": "on"}
POLICY = PolicyConfig(
    remember_acts=COUNT, frame_stack=2, hidden_sizes=[8], rollout_steps=24, time_horizon=24, minibatch_size=32
)


def written(device, axes, choices, reward):
    """Return one past act as numbers."""
    shares = [
        2 * (value - axis.low) / (axis.high - axis.low) - 1 for value, axis in zip(axes, device.axes, strict=True)
    ]
    ones = [np.eye(len(one.choices))[choice] for choice, one in zip(choices, device.branches, strict=True)]
    return [1.0, *shares, *(one for row in ones for one in row), np.sign(reward) * np.log(1 + abs(reward))]


def side_by_side(acts, width):
    """Return the last acts of an episode, oldest first, after zeros."""
    numbers = [number for act in acts[-COUNT:] for number in act]
    return [0.0] * (COUNT * width - len(numbers)) + numbers


def test_acts_are_written_as_shares_and_ones_and_their_reward_comes_later():
    device = behavior("b", sensors=[sensor("s", [1])], axes=[axis("x", 0.0, 4.0)], branches=[branch("k", ["a", "b"])])
    past = PastActs(device.device, 2)
    acts = ActArrays(np.array([[3.0], [0.0]], np.float32), np.array([[1], [0]], np.int32))
    now = past.note(np.zeros((2, past.size), np.float32), acts, np.array([True, False]))
    np.testing.assert_array_equal(now, [[0] * 5 + [1, 0.5, 0, 1, 0], [0] * 10])
    over = np.array([True, False])
    step = StepArrays([], np.zeros((2, 1)), over, ~over)
    step.ended = np.array([0])
    last = past.settle(now, np.array([-(np.e - 1), 5.0]), step)
    np.testing.assert_allclose(last, [[0] * 5 + [1, 0.5, 0, 1, -1]], rtol=1e-6)
    assert not now.any(), "a reward before the first act, or after an episode, is remembered"


@pytest.mark.parametrize("game", ["hybrid", "duel"])
def test_each_decision_of_a_rollout_sees_the_acts_and_rewards_before_it(game):
    seen = 0
    spec = load_games(PLACES)[game].describe(DEFAULTS)
    for policy in full_agents(game, {}, Config(game=game, arenas=4, policy=POLICY)):
        rollout, actor = policy.rollout, policy.actor
        device, width = spec.behaviors[actor.behavior].device, actor.past.size // COUNT
        decided = rollout.decided()
        steps, lanes = decided.shape
        axes = np.zeros((steps, lanes, len(device.axes)), np.float32)
        choices = np.zeros((steps, lanes, len(device.branches)), np.int32)
        for t in range(steps):
            masks = None if rollout.masks is None else masks_of(rollout.masks[t], device)
            act = ActArrays(axes[t], choices[t])
            actor.layout.write(rollout.continuous[t], rollout.discrete[t], act, masks)
        for lane in range(lanes):
            acts: list[list[float]] = []
            for t in map(int, np.flatnonzero(decided[:, lane])):
                got = rollout.observations[t, lane, : actor.past.size]
                np.testing.assert_allclose(got, side_by_side(acts, width), atol=1e-5)
                seen += bool(acts)
                acts.append(written(device, axes[t, lane], choices[t, lane], rollout.rewards[t, lane]))
                if rollout.terminated[t, lane] or rollout.truncated[t, lane]:
                    acts = []
    assert seen > 50


def masks_of(added, device):
    return [added[:, index, : len(one.choices)] == 0 for index, one in enumerate(device.branches)]


@pytest.fixture(scope="module")
def run(simulator, tmp_path_factory):
    """Return a run of a policy that remembers acts and has a hand that is two decisions late."""
    folder = tmp_path_factory.mktemp("late") / "run"
    config = Config(
        game="hybrid",
        arenas=2,
        total_timesteps=96,
        log_interval=96,
        hand=HandConfig(delay=2),
        policy=POLICY,
        options={"masks": "off"},
    )
    train(config, folder, [simulator], resume=False)
    return folder


def test_who_plays_remembers_what_was_chosen_before_the_hand_delayed_it(run, simulator):
    agent, compared = load(run), 0
    with open_play(PlaySpec(run, simulator, seed=1)) as play:
        (player,), behavior = play.players, play.spec.behaviors[0]
        past, width, device = player.actor.past, player.actor.past.size // COUNT, behavior.device
        chosen: list[list[float]] = []
        rewards: dict[str, float] = {}
        for decision in islice(play.decisions(), 60):
            before, act, after = decision.before[0], decision.acts[0], decision.after[0]
            names = [sensor.name for sensor in behavior.sensors]
            action = agent.act(dict(zip(names, (a[0] for a in before.observations), strict=True)), rewards=rewards)
            assert list(action.values()) == [*act.axes[0].tolist(), *act.choices[0].tolist()]
            rewards = dict(zip((c.name for c in behavior.channels), after.rewards[0].tolist(), strict=True))
            now = player.observations.numbers[0, : past.size]
            if after.terminated[0] or after.truncated[0]:
                assert not now.any()
                agent.begin()
                chosen = []
                continue
            chosen.append(now[-width:].tolist())
            reward = decision.rewards[0][0]
            assert chosen[-1][-1] == pytest.approx(np.sign(reward) * np.log(1 + abs(reward)), rel=1e-5)
            np.testing.assert_array_equal(now, np.float32(side_by_side(chosen, width)))
            if len(chosen) > 2:  # what was chosen two decisions ago is done now
                done = written(device, act.axes[0], act.choices[0], 0.0)
                np.testing.assert_allclose(done[:-1], chosen[-3][:-1], atol=1e-5)
                compared += 1
    assert compared > 10
    with pytest.raises(TensorError, match="rewards: there is no channel 'fame', expected gain, cost"):
        agent.act(dict(zip(names, (a[0] for a in before.observations), strict=True)), rewards={"fame": 1.0})


def test_demonstrations_are_cloned_with_the_acts_before_them(simulator, tmp_path):
    with_acts = Config(game="hybrid", policy=POLICY, arenas=2)
    file = record(tmp_path, simulator)
    spec = describe(simulator, "hybrid", {})
    shown = load_demonstration(file, spec)
    (actor,) = make_actors(with_acts, spec)
    actions, _, _ = targets(actor, [shown], with_acts)
    assert actions is not None
    wanted, width, device = [], actor.past.size // COUNT, spec.behaviors[0].device
    for stretch in shown.stretches:
        acts: list[list[list[float]]] = [[], []]
        ends = stretch.ends(0)
        for number, (act,) in enumerate(stretch.acts):
            after = stretch.steps[number + 1][0]
            rewards = actor.encoder.rewards(after)
            wanted += [side_by_side(acts[lane], width) for lane in range(2) if number <= ends[lane]]
            for lane in range(2):
                acts[lane].append(written(device, act.axes[lane], act.choices[lane], rewards[lane]))
                if after.terminated[lane] or after.truncated[lane]:
                    acts[lane] = []
    np.testing.assert_allclose(actions.observations.numbers[:, : actor.past.size], wanted, atol=1e-5)


def test_what_cannot_take_past_acts_is_named(run, simulator, tmp_path, capsys):
    assert main(["export", str(run), str(tmp_path / "policy.json"), "--simulator", simulator]) == 1
    assert "player: policies that see their last actions cannot be exported" in capsys.readouterr().err
