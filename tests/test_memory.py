"""What policies remember: states per lane, whole sequences in minibatches, and gradients that flow back in time."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
import torch

from joybridge.config.config import Config, HandConfig
from joybridge.config.policy_config import MemoryConfig, PolicyConfig
from joybridge.contract.codec import StepArrays
from joybridge.layouts import make_acts
from joybridge.play.playing import PlaySpec, open_play
from joybridge.policy.actor import make_actors
from joybridge.policy.player import PolicyPlayer
from joybridge.ppo.cloning import refresh
from joybridge.ppo.loss import autograd_gradient
from joybridge.ppo.networks import flatten_parameters
from joybridge.ppo.observation_tensors import Observations
from joybridge.ppo.schedule import Coefficients
from joybridge.run.run_state import load_state
from joybridge.run.train import learn, train
from joybridge.simulator.catalog import load_games
from tests.support.games import PLACES
from tests.test_policy import full_agents

COEFFICIENTS = Coefficients(1e-3, 0.2, 0.01)


def remembering(kind: str, *, length: int = 8, game: str = "hybrid", layout: str = "hybrid", **keys) -> Config:
    policy = PolicyConfig(
        hidden_sizes=[16],
        rollout_steps=20,
        time_horizon=20,
        minibatch_size=16,
        epochs=2,
        memory=MemoryConfig(kind=kind, size=6, length=length),
        **keys,
    )
    return Config(game=game, layout=layout, arenas=4, policy=policy)


def full_batch(policy, length: int):
    decided = policy.rollout.decided()
    advantages = np.random.default_rng(0).normal(size=decided.shape).astype(np.float32)
    return policy.rollout.batch(advantages, decided, length), decided


def walk(policy, decided):
    """Yield (step, lane, state before, outputs) of the decisions of one lane after the other, one at a time."""
    rollout, kind = policy.rollout, policy.actor.network.value_bias.dtype
    for lane in range(rollout.rewards.shape[1]):
        state = torch.from_numpy(rollout.memory[0, lane : lane + 1]).to(kind)
        for t in np.flatnonzero(decided[:, lane]):
            seen = Observations(torch.from_numpy(rollout.observations[t, lane : lane + 1]).to(kind))
            heads = policy.actor.network.heads(seen.in_sequences(state, torch.ones(1, dtype=torch.int64)))
            yield t, lane, state, heads
            ended = rollout.terminated[t, lane] | rollout.truncated[t, lane]
            state = torch.zeros_like(heads.memory) if ended else heads.memory


@pytest.mark.parametrize(
    ("kind", "shared", "game"), [("gru", True, "hybrid"), ("lstm", False, "hybrid"), ("gru", False, "ferry")]
)
def test_the_gradient_of_sequences_is_that_of_whole_episodes_walked_through_step_by_step(kind, shared, game):
    for policy in full_agents(game, {}, remembering(kind, game=game, shared_body=shared)):
        batch, decided = full_batch(policy, 20)  # as long as the rollout: no sequence is cut
        parameters = list(policy.actor.network.double().parameters())
        walked = [heads for *_, heads in walk(policy, decided)]
        weights = torch.arange(len(walked), dtype=torch.float64).sin()
        naive = (torch.cat([each.value for each in walked]) * weights).sum()
        naive = naive + (torch.cat([each.outputs for each in walked]) * weights[:, None]).sum()
        seen = batch.minibatch(torch.arange(batch.units)).observations
        exact = Observations(seen.numbers.double()).in_sequences(seen.recall.states.double(), seen.recall.lengths)
        got = policy.actor.network.heads(exact)
        total = (got.value * weights).sum() + (got.outputs * weights[:, None]).sum()
        ours, theirs = (torch.autograd.grad(each, parameters, allow_unused=True) for each in (total, naive))
        assert len(walked) == len(got.value) == decided.sum()
        for one, other in zip(ours, theirs, strict=True):
            assert (one is None) is (other is None)
            if one is not None:
                torch.testing.assert_close(one, other, atol=1e-6 * float(other.abs().max()), rtol=1e-6)


@pytest.mark.parametrize(
    ("kind", "layout", "length"),
    [
        ("gru", "hybrid", 7),
        ("lstm", "hybrid", 20),
        ("gru", "bucket-5", 1),
        ("lstm", "multiagent", 7),
        ("gru", "beta", 7),
    ],
)
def test_what_was_sampled_has_the_same_log_probability_when_it_is_learned(kind, layout, length):
    """The states before all sequences are those with which the lanes acted; masks and lanes that wait included."""
    config = remembering(kind, length=length, layout=layout, game="hybrid")
    for policy in full_agents("hybrid", {"masks": "on"}, config):
        batch, decided = full_batch(policy, length)
        assert int(batch.sequences.lengths.max()) <= length and int(batch.sequences.lengths.sum()) == decided.sum()
        flatten_parameters(policy.actor.network)
        gradient = partial(autograd_gradient, policy.actor.network)
        for units in (torch.arange(batch.units), torch.arange(batch.units).flip(0)[:5]):
            statistics = gradient(batch, units, COEFFICIENTS)
            assert statistics[3] == pytest.approx(0.0, abs=1e-6)  # the KL divergence
            assert statistics[4] == 0.0  # of ratios beyond the clip range


def test_a_lane_that_waits_remembers_the_same_and_one_that_ends_nothing():
    (policy,) = full_agents("noughts", {}, remembering("gru", game="noughts"))
    rollout, decided = policy.rollout, policy.rollout.decided()
    assert rollout.memory is not None and not rollout.deciding.all() and rollout.terminated.any()
    for t, lane, state, _ in walk(policy, decided):
        np.testing.assert_allclose(rollout.memory[t, lane], state[0].detach(), atol=1e-6)


@pytest.mark.parametrize("game", ["hybrid", "ferry"])
def test_an_update_learns_in_whole_sequences_and_leaves_finite_weights(game):
    for policy in full_agents(game, {}, remembering("lstm", game=game)):
        before = policy.actor.state()
        statistics = learn(policy, 0.1)
        after = policy.actor.state()
        assert np.isfinite(list(statistics.values())).all()
        assert all((before[name] != after[name]).any() for name in before if "memory" in name and "bias" not in name)
        memory = policy.rollout.memory
        assert memory is not None
        np.testing.assert_array_equal(memory[0], memory[-1])


def test_who_plays_remembers_what_a_walk_through_its_episodes_gives():
    spec = load_games(PLACES)["recall"].describe({"task": "echo"})
    (actor,) = make_actors(remembering("gru", game="recall", frame_stack=1), spec)
    player, rng, acts = PolicyPlayer(actor, 3, 0, deterministic=True), np.random.default_rng(1), make_acts(spec, 3)
    state = torch.zeros(3, actor.network.state_size)
    for t in range(40):
        over = rng.random(3) < (0.2 if t else 0.0)
        shown = rng.random((3, 5)).astype(np.float32)
        step = StepArrays([shown[:, :4], shown[:, 4:]], np.zeros((3, 1), np.float32), over, np.zeros(3, bool))
        step.deciding = over | (rng.random(3) < 0.7)
        step.ended = np.flatnonzero(over).astype(np.int32)
        if t:
            player.store(step)
        else:
            player.begin(step)
        state[torch.from_numpy(over)] = 0.0
        remembered, seen = player.observations.memory, torch.from_numpy(player.observations.numbers)
        assert remembered is not None
        np.testing.assert_allclose(remembered, state, atol=1e-6)
        with torch.no_grad():
            after = actor.network.heads(Observations(seen).in_sequences(state, torch.ones(3, dtype=torch.int64))).memory
        assert after is not None
        state = torch.where(torch.from_numpy(step.deciding)[:, None], after, state)
        player.act(step, acts[0])


@pytest.mark.parametrize(
    ("steps", "rate", "least"),
    [
        (8, 3e-4, 0.995),  # of Adam, as many as an update with common settings has in one epoch
        (16, 1e-3, 0.9),
        (32, 2e-3, 0.7),
    ],
)
def test_states_that_are_stored_turn_the_gradient_little_when_they_are_some_updates_old(steps, rate, least):
    """The weights change with each minibatch of an update, the states before its sequences do not."""
    config = remembering("gru", game="hybrid", length=5, shared_body=True)
    (policy,) = full_agents("hybrid", {}, config)
    batch, decided = full_batch(policy, 5)
    every = torch.arange(batch.units)
    gradient = policy.learner.weights.grad
    assert batch.sequences is not None and gradient is not None
    for _ in range(steps):
        policy.learner.gradient(batch, every, COEFFICIENTS)
        policy.learner.step(rate)
    policy.learner.gradient(batch, every, COEFFICIENTS)
    stale = gradient.clone()
    with torch.no_grad():
        states = {(t, lane): state for t, lane, state, _ in walk(policy, decided)}
    places = np.argwhere(decided.T)[batch.sequences.begins.numpy()]
    now = torch.cat([states[t, lane] for lane, t in places])
    fresh = replace(batch, sequences=batch.sequences._replace(states=now))
    policy.learner.gradient(fresh, every, COEFFICIENTS)
    turned = torch.nn.functional.cosine_similarity(stale, gradient, dim=0)
    assert not torch.equal(batch.sequences.states, now)
    assert least < float(turned) < 1.0


def test_demonstrations_are_cloned_with_what_the_network_remembers_of_their_episodes_now():
    (policy,) = full_agents("recall", {"task": "echo"}, remembering("lstm", game="recall", frame_stack=1))
    whole, _ = full_batch(policy, 20)
    assert whole.sequences is not None
    actions, _ = full_batch(policy, 4)
    assert actions.sequences is not None
    nonsense = actions.sequences._replace(states=torch.full_like(actions.sequences.states, 9.0))
    fresh = refresh(policy.actor.network, replace(actions, sequences=nonsense))
    assert fresh.sequences is not None
    assert int(fresh.sequences.parts.max()) == 4
    with torch.no_grad():
        every = policy.actor.network.heads(
            replace(whole, sequences=whole.sequences._replace(states=torch.zeros_like(whole.sequences.states)))
            .minibatch(torch.arange(whole.units))
            .observations
        )
        cut = policy.actor.network.heads(fresh.minibatch(torch.arange(fresh.units)).observations)
    torch.testing.assert_close(cut.outputs, every.outputs, atol=1e-6, rtol=1e-5)


def test_a_run_with_memory_that_is_cut_off_and_resumed_ends_in_the_same_bits(simulator, tmp_path):
    late = {"total_timesteps": 480, "log_interval": 160, "pipeline_groups": 2, "hand": HandConfig(delay=3)}
    config = remembering("gru", game="shooting_birds", frame_stack=1, remember_acts=2).model_copy(update=late)
    once, twice = tmp_path / "once", tmp_path / "twice"
    train(config, once, [simulator], resume=False)
    train(config.model_copy(update={"stop_at": 160}), twice, [simulator], resume=False)
    assert any(array.any() for name, array in load_state(twice).arrays.items() if name.endswith("/policy/memory"))
    train(config, twice, [simulator], resume=True)
    wanted, got = load_state(once).arrays, load_state(twice).arrays
    assert wanted.keys() == got.keys()
    for name, array in wanted.items():
        assert array.tobytes() == got[name].tobytes(), name
    with open_play(PlaySpec(twice, simulator, seed=1), episodes=4) as play:
        (player,) = play.players
        next(play.decisions())
        assert player.observations.memory is not None and player.observations.memory.any()


@pytest.mark.parametrize(
    "wrong",
    [
        lambda right: np.full_like(right, np.nan),
        lambda right: right[:, :3],
        lambda right: np.zeros((), np.float32),
        lambda right: right.astype(np.uint8),
    ],
)
@pytest.mark.parametrize("place", ["memory", "observations"])
def test_a_state_that_no_lane_can_be_in_is_refused(wrong, place):
    (policy,) = full_agents("hybrid", {}, remembering("gru"))
    state = policy.state()
    policy.load(state)
    with pytest.raises(ValueError, match=r"expected finite float32 \["):
        policy.load({**state, place: wrong(state[place])})
