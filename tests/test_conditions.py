"""Axes that count only with a choice: under no layout do they add anything where they do not count."""

import math
from contextlib import closing
from dataclasses import replace

import numpy as np
import pytest
import torch

from joybridge.config.config import Config, HandConfig
from joybridge.config.errors import ConfigError
from joybridge.config.policy_config import MemoryConfig, PolicyConfig
from joybridge.contract.codec import StepArrays
from joybridge.layouts import ActionSpace, JointTable, make_acts, make_layouts
from joybridge.layouts.conditions import Conditions
from joybridge.policy.actor import make_actors
from joybridge.policy.policy import Policy
from joybridge.ppo.fast.gradient import ClosedFormGradient
from joybridge.ppo.loss import Batch, acted_log_probs, joint_log_probs
from joybridge.ppo.networks import Network, Outputs, Towers, flatten_parameters
from joybridge.ppo.observation_tensors import Observations
from joybridge.ppo.schedule import Coefficients
from joybridge.run.collect import collect, group_bounds, open_groups
from joybridge.run.profiler import Profiler
from joybridge.run.train import learn
from joybridge.simulator import axis, behavior, branch, button, sensor
from joybridge.v1 import bridge_pb2 as pb
from tests.test_policy import full_agents, small

LANES = 8
PLAYER = behavior(
    "player",
    sensors=[sensor("seen", [5], -1, 1)],
    axes=[
        axis("turn", 0, 1, only_with=("act", "turn")),
        axis("power", 0, 1, only_with=("act", "kick")),
        axis("free"),
        axis("aim", only_with=("press", "pressed")),
    ],
    branches=[button("press"), branch("act", ["kick", "turn", "wait"])],
)
CHOICES = np.array([[0, 0], [1, 1], [1, 2]], np.int32)  # released and kick; pressed and turn; pressed and wait
TURN, POWER, FREE, AIM = [False, True, False], [True, False, False], [True] * 3, [False, True, True]
LAYOUTS = [
    "hybrid",
    "beta",
    "squashed",
    "gsde-2",
    "bucket-5",
    "ordinal-5",
    "threshold-0.0",
    "threshold-0.5",
    "multiagent",
    "hybrid, turn=bucket-5, aim=joint-5",
]


def test_an_axis_that_does_not_count_adds_nothing_in_the_old_and_in_the_new_policy():
    """One axis per choice: 0.5, 0.3 and 0.2, of which the second is chosen; all axes have mean 0.1, deviation 0.5."""
    space = ActionSpace(3, (3,))
    logits = torch.tensor([0.5, 0.3, 0.2]).log().reshape(1, 1, 3)
    means, log_variance = torch.full((1, 3), 0.1, requires_grad=True), torch.full((3,), math.log(0.25))
    empty, counts = torch.zeros(1), torch.tensor([[True, False, True, False]])
    seen, continuous = Observations(torch.zeros(1, 1)), torch.tensor([[9.0, 0.4, -9.0]])
    batch = Batch(seen, continuous, torch.tensor([[1]]), None, empty, empty, empty + 1.0, empty, counts=counts)
    log_probs, entropy, _ = joint_log_probs(Outputs(logits, means, torch.zeros(1)), log_variance, batch)
    assert float(log_probs.detach()) == pytest.approx(-1.609765, abs=1e-6)
    assert float(entropy) == pytest.approx(1.755444, abs=1e-6)
    (gradient,) = torch.autograd.grad(log_probs.sum(), means)
    assert gradient[0, 0] == gradient[0, 2] == 0.0 and gradient[0, 1] == pytest.approx(0.3 / 0.25)
    network = Network(1, space, Towers([4]), 0)
    flat = flatten_parameters(network)
    with torch.no_grad():
        network.actor.head.weight.zero_()
        network.actor.head.weight[:3] = 0.0
        network.mean_bias.fill_(0.1)
        network.log_variance.fill_(math.log(0.25))
    batch.log_probs = acted_log_probs(network, batch, 1)
    assert float(batch.log_probs) == pytest.approx(-math.log(3) - 0.405792, abs=1e-5)
    statistics = ClosedFormGradient(network)(batch, torch.arange(1), Coefficients(1e-3, 0.2, 0.1))
    assert statistics[2] == pytest.approx(math.log(3) + 0.725791, abs=1e-5)
    assert statistics[3] == pytest.approx(0.0, abs=1e-6)
    assert flat.grad is not None and network.mean_bias.grad is not None and network.log_variance.grad is not None
    assert network.mean_bias.grad[[0, 2]].tolist() == network.log_variance.grad[[0, 2]].tolist() == [0.0, 0.0]
    assert network.mean_bias.grad[1] == pytest.approx(-0.3 / 0.25)


@pytest.mark.parametrize(
    ("layout", "expected"),
    [
        ("hybrid", {"": [FREE, FREE, TURN, POWER, FREE, AIM]}),
        ("beta", {"": [FREE, FREE, TURN, POWER, FREE, AIM]}),
        ("bucket-3", {"": [TURN, POWER, FREE, AIM, FREE, FREE]}),
        ("ordinal-3-mu", {"": [TURN, POWER, FREE, AIM, FREE, FREE]}),
        ("threshold-0.5", {"": [TURN, POWER, FREE, AIM, FREE, FREE]}),
        ("multiagent", {"axes": [FREE, TURN, POWER, FREE, AIM], "buttons": None}),
        ("joint-3", {"": None}),
        ("hybrid, turn=joint-3, power=joint-3", {"": [[True, True, False], FREE, FREE, FREE, AIM]}),
    ],
)
def test_every_layout_knows_which_parts_of_its_actions_count(layout, expected):
    for name, made in make_layouts(layout, PLAYER.device).items():
        conditions = Conditions(made, PLAYER.device)
        assert bool(conditions) is (expected[name] is not None)
        if expected[name] is not None:
            assert conditions.counts(CHOICES).T.tolist() == expected[name]


def test_a_joint_choice_has_no_combinations_that_differ_only_in_what_does_not_count():
    (layout,) = make_layouts("joint-3", PLAYER.device).values()
    (table,) = layout.discrete
    assert len(table.values) == 3 * (2 * 3 + 1) * (1 + 3)  # free x (turn or power, or neither) x (released or aim)
    assert isinstance(table, JointTable) and table.positions is not None
    waiting = table.values[:, 1] == 2
    assert set(table.positions[waiting, 0]) == {0.5} and set(table.positions[table.values[:, 1] == 1, 0]) == {0, 0.5, 1}
    crowd = pb.Device(
        axes=PLAYER.device.axes, branches=[*PLAYER.device.branches, *(button(f"b{i}") for i in range(30))]
    )
    with pytest.raises(ConfigError, match="joint choices, expected at most 10,000"):
        make_layouts("joint-3", crowd)


@pytest.mark.parametrize("autograd", [False, True])
@pytest.mark.parametrize("layout", LAYOUTS)
def test_an_update_moves_nothing_of_a_part_that_never_counted(layout, autograd):
    spec = pb.GameSpec(name="kicks", behaviors=[PLAYER])
    learning = PolicyConfig(hidden_sizes=[8], rollout_steps=4, time_horizon=4, minibatch_size=16, autograd=autograd)
    config = Config(game="kicks", layout=layout, policy=learning)
    policies = [Policy(actor, PLAYER, [0, LANES]) for actor in make_actors(config, spec)]
    random, never, acts = np.random.default_rng(0), np.zeros(LANES, bool), make_acts(spec, LANES)

    def shown() -> list[StepArrays]:
        seen = random.uniform(-1, 1, (LANES, 5)).astype(np.float32)
        return [StepArrays([seen], random.normal(size=(LANES, 1)).astype(np.float32), never, never)]

    for policy in policies:
        policy.begin([shown()])
    while not policies[0].rollout.full:
        for policy in policies:
            policy.act(shown(), acts)
        acts[0].choices[:] = CHOICES[0]  # whatever they chose, this is what the device was given
        for policy in policies:
            policy.note(acts)
            policy.store(shown())
    for policy in policies:
        before = policy.actor.state()
        counts = policy.conditions[0].counts(CHOICES[:1])[0] if policy.conditions else np.ones(0, bool)
        learn(policy, 0.1)
        moved = {name: (array != before[name]) for name, array in policy.actor.state().items()}
        network, branches = policy.actor.network, len(policy.actor.branches)
        for part, counted in enumerate(counts):
            if part < branches:
                first, size = part * network.space.widest, network.space.branches[part]
                rows = slice(first, first + size)
            else:
                outputs = [each.outputs for each in network.distributions] or [1] * network.space.continuous
                first = network.pad.numel() + sum(outputs[: part - branches])
                rows = slice(first, first + outputs[part - branches])
            assert moved["actor.head.weight"][rows].any() == counted, part
        if not network.distributions and len(counts):
            assert moved["log_variance"].tolist() == moved["mean_bias"].tolist() == counts[branches:].tolist()


@pytest.mark.parametrize("layout", ["hybrid", "bucket-5", "threshold-0.0", "beta"])
def test_the_ratio_is_1_before_an_update_and_only_counting_parts_change_it(layout):
    (policy,) = full_agents("moving", {}, small(layout, autograd=True, game="moving"))
    batch = policy.rollout.batch(np.ones_like(policy.rollout.rewards), policy.rollout.decided())
    assert batch.counts is not None and not batch.counts.all() and batch.counts.any(0).all()
    network = policy.actor.network
    old = acted_log_probs(network, batch, 7)
    assert torch.equal(old, acted_log_probs(network, batch, 7))
    whole = acted_log_probs(network, replace(batch, counts=None), len(batch))
    torch.testing.assert_close(whole, batch.log_probs, atol=2e-5, rtol=0)
    assert not torch.allclose(whole, old)
    (closed,) = full_agents("moving", {}, small("hybrid", autograd=False, game="moving"))
    statistics = learn(closed, 0.1)
    assert 0 <= statistics["approx_kl"] < 0.1


def test_with_memory_the_old_policy_is_that_of_whole_sequences():
    config = small("bucket-5", autograd=True, game="moving")
    remembering = config.policy.model_copy(update={"memory": MemoryConfig(kind="gru", size=8, length=6)})
    (policy,) = full_agents("moving", {}, config.model_copy(update={"policy": remembering}))
    batch = policy.rollout.batch(np.ones_like(policy.rollout.rewards), policy.rollout.decided(), 6)
    whole = acted_log_probs(policy.actor.network, replace(batch, counts=None), 3)
    torch.testing.assert_close(whole, batch.log_probs, atol=2e-5, rtol=0)
    counting = acted_log_probs(policy.actor.network, batch, 3)
    assert not torch.allclose(counting, whole) and 0 <= learn(policy, 0.1)["approx_kl"] < 0.1


def test_training_notes_what_all_policies_chose_before_a_hand_acts(simulator):
    config = small("hybrid", autograd=False, game="moving").model_copy(
        update={"hand": HandConfig(delay=3), "pipeline_groups": 1}
    )
    (group,) = groups = open_groups(config, [simulator], None, {}, {})
    with closing(group.session):
        (actor,) = make_actors(config, group.session.spec)
        policy = Policy(actor, group.session.spec.behaviors[0], group_bounds(config))
        policy.begin([group.session.steps])
        for _ in collect(groups, [policy], Profiler(), steps=5):
            pass
    chosen = policy.rollout.discrete[:5, :, 0]
    assert policy.rollout.counts is not None
    assert policy.rollout.counts[:5, :, 1:].tolist() == np.stack([chosen == 0, chosen == 1], -1).tolist()
